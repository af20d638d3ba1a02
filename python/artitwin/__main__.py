"""`python -m artitwin` is the program of this package."""

import os
import sys

from .process import program

os.execv(program(), ["artitwin", *sys.argv[1:]])
