"""`python -m artitwin.fleet` is `artitwin fleet`."""

import sys

from .cli import main

sys.exit(main())
