"""A lock and a folder of this machine for one job at a time."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .store import MayPassError

_TRIES = 16
"""Times that a lock is looked for whose file is removed meanwhile."""


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Holds a lock on a file, which goes away with it. The system takes the lock of a process that was killed."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = _locked(path)
    except OSError as error:
        raise MayPassError(f"cannot use `{path}`: {error}") from error
    try:
        yield
    finally:
        # While the lock is held, so that nobody who finds the file takes it for a lock of his own.
        path.unlink(missing_ok=True)
        os.close(lock)


def _locked(path: Path) -> int:
    for _ in range(_TRIES):
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Who held it may have removed the file since it was opened here: a new one is locked then.
            if path.exists() and os.path.samestat(os.fstat(file), path.stat()):
                return file
        except BlockingIOError as error:
            os.close(file)
            raise MayPassError(f"another process works on the same job and holds `{path}`") from error
        os.close(file)
    raise MayPassError(f"other processes take `{path}` in turn")


def base(folder: str | None) -> Path:
    """Where the folders of jobs are: that one, or the system's for temporary files."""
    return Path(folder or tempfile.gettempdir())


def made(at: Path) -> Path:
    """The folder of a job, made where it is missing; what an earlier attempt left in it is there."""
    try:
        # Recordings may be secret where the disk is shared.
        at.mkdir(mode=0o700, parents=True, exist_ok=True)
        # Its name can be foreseen.
        if at.is_symlink() or at.stat().st_uid != os.geteuid():
            raise MayPassError(f"`{at}` is of another user; give another --scratch")
    except OSError as error:
        raise MayPassError(f"cannot use `{at}`: {error}") from error
    return at
