"""A program run to its end on this machine, and what it took."""

import math
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

_STOP_S = 60.0
"""measured: docs/figures.md; the longest step after which a run looks at its stop flag takes under 20 s."""
_LISTEN_S = 0.25
"""derived: Ray cancels a task by a flag of the interpreter, which ends no system call: it is seen so late. The end of the
program is seen at once."""
_LAST_LINE = 16 << 20
"""Most bytes that are read of the last line; a manifest of 1000 files has under 1 MB."""
_MESSAGE = 64 << 10
"""Most bytes of standard error that are kept."""


@dataclass(frozen=True)
class Ended:
    """How a program ended."""

    exit_code: int
    """Negative: the signal that ended it."""
    last_line: str
    message: str
    """The end of its standard error."""
    seconds: float
    cpu_seconds: float
    peak_memory_bytes: int
    overtime: bool
    """It was stopped since it took longer than it may."""


def run(
    arguments: Sequence[str], environment: Mapping[str, str], folder: str | None, limit_s: float | None
) -> Ended:
    """Runs a program in a folder; it dies with this process. An interruption (a canceled task) is passed on to it as
    Ctrl-C, waited for, and raised again."""
    leash = [sys.executable, "-I", "-S", str(Path(__file__).with_name("leash.py")), str(os.getpid())]
    # Files, not pipes: nobody has to read while the program runs.
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as printed:
        start = time.monotonic()
        process = subprocess.Popen(
            [*leash, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=said,
            cwd=folder,
            env={**os.environ, **environment},
            start_new_session=True,
        )
        overtime = False
        try:
            usage = _wait(process, limit_s)
            if usage is None:
                overtime = True
                usage = _stop(process)
        except BaseException:
            _stop(process)
            raise
        status, used = usage
        return Ended(
            exit_code=os.waitstatus_to_exitcode(status),
            last_line=_last_line(printed),
            message=_tail(said, _MESSAGE).strip(),
            seconds=time.monotonic() - start,
            cpu_seconds=used.ru_utime + used.ru_stime,
            peak_memory_bytes=used.ru_maxrss * 1024,
            overtime=overtime,
        )


def _wait(
    process: "subprocess.Popen[bytes]", limit_s: float | None
) -> tuple[int, resource.struct_rusage] | None:
    """What wait4 gives; None after the limit."""
    end = math.inf if limit_s is None else time.monotonic() + limit_s
    ended = os.pidfd_open(process.pid)
    try:
        poll = select.poll()
        poll.register(ended, select.POLLIN)
        while not poll.poll(1000.0 * min(_LISTEN_S, max(0.0, end - time.monotonic()))):
            if time.monotonic() >= end:
                return None
    finally:
        os.close(ended)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return status, used


def _stop(process: "subprocess.Popen[bytes]") -> tuple[int, resource.struct_rusage]:
    """Asks a program to leave a usable state, and ends it where it does not."""
    process.send_signal(signal.SIGINT)
    try:
        ended = _wait(process, _STOP_S)
    except BaseException:
        process.kill()
        _wait(process, None)
        raise
    if ended is None:
        process.kill()
        ended = _wait(process, None)
    assert ended is not None
    return ended


def _last_line(file: IO[bytes]) -> str:
    return _tail(file, _LAST_LINE).rstrip().rpartition("\n")[2]


def _tail(file: IO[bytes], most: int) -> str:
    length = file.seek(0, os.SEEK_END)
    file.seek(max(0, length - most))
    return file.read(most).decode("utf-8", "replace")
