"""Becomes a program that the kernel kills when the process that asked for it dies.

usage: leash.py PARENT PROGRAM [ARGUMENT...]

A worker that is killed takes its job with it, so no second writer runs beside the retried one. A file of its
own, run by the interpreter without packages: code between fork and exec of a worker with threads may hang.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1
"""Of prctl(2)."""
NOT_STARTED = 127
"""Exit code of a program that cannot be run, as of a shell."""


def main() -> None:
    parent, arguments = int(sys.argv[1]), sys.argv[2:]
    if ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0) != 0:
        sys.exit("error: prctl(PR_SET_PDEATHSIG) was refused")
    # It died before the call above.
    if os.getppid() != parent:
        sys.exit(128 + signal.SIGKILL)
    # Ray's processes block Ctrl-C, and Python ignores a closed pipe; both would be inherited.
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execv(arguments[0], arguments)
    except OSError as error:
        print(f"error: cannot run `{arguments[0]}`: {error.strerror}", file=sys.stderr)
        sys.exit(NOT_STARTED)


if __name__ == "__main__":
    main()
