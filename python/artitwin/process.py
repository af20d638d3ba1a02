"""The program: where it is, and how it is run."""

import importlib.metadata
import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO

from .errors import ProgramError, ended

StrPath = str | os.PathLike[str]


def program() -> Path:
    """Path of the program: `ARTITWIN_PROGRAM`, else that of this wheel, else `artitwin` on the PATH."""
    named = os.environ.get("ARTITWIN_PROGRAM")
    if named:
        return Path(named)
    found = _of_wheel() or shutil.which("artitwin")
    if found is None:
        raise ProgramError("the program is not installed; install the wheel, or set ARTITWIN_PROGRAM")
    return Path(found)


def _of_wheel() -> Path | None:
    """The program where pip put it, which is not always beside the interpreter (`--user`)."""
    try:
        files = importlib.metadata.files("artitwin") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    named = (file.locate() for file in files if file.name == "artitwin" and file.parent.name == "bin")
    # `--target` moves it without saying so.
    beside = Path(__file__).parents[1] / "bin" / "artitwin"
    scripts = [*(Path(os.path.normpath(str(path))) for path in named), beside]
    return next((script for script in scripts if script.is_file()), None)


def option(name: str, value: str | int | float | bool | None) -> list[str]:
    """An option of the command line: None and False are left out, True is a flag."""
    if value is None or value is False:
        return []
    return [f"--{name}" if value is True else f"--{name}={value}"]


def options(name: str, values: Iterable[str | int | float]) -> list[str]:
    """An option that is given once for each value."""
    return [argument for value in values for argument in option(name, value)]


def paths(values: StrPath | Iterable[StrPath]) -> list[str]:
    """One path or several."""
    several = [values] if isinstance(values, (str, os.PathLike)) else values
    return [os.fspath(value) for value in several]


def commas(values: Iterable[float] | None) -> str | None:
    """Numbers as the program reads them."""
    return None if values is None else ",".join(repr(float(value)) for value in values)


def run(arguments: Iterable[str], on_line: Callable[[str], object] | None = None) -> str:
    """Runs a command and gives its standard output, each line of which `on_line` gets when it comes.

    Ctrl-C, or an error of `on_line`, asks the program to stop, waits until it has left a usable state, and is
    raised again; a second Ctrl-C ends it at once.
    """
    exit_code, output, message = run_whatever(arguments, on_line)
    if exit_code not in (0, 3):
        raise ended(exit_code, message)
    return output


def run_whatever(
    arguments: Iterable[str], on_line: Callable[[str], object] | None = None
) -> tuple[int, str, str]:
    """The same, however it ends: its exit code, its output, and its last error or all that it said."""
    lines: list[str] = []
    # A file, not a pipe: nobody has to read while the program runs.
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said:
        process = _started([os.fspath(program()), *arguments], said)
        assert process.stdout is not None
        try:
            for line in process.stdout:
                lines.append(line)
                if on_line is not None:
                    on_line(line)
            process.wait()
        except BaseException:
            _stop(process)
            raise
        said.seek(0)
        text = said.read().strip()
    # Warnings may come before the error, which may have more lines than one.
    return process.returncode, "".join(lines), re.split(r"(?m)^error: ", text)[-1]


def _started(arguments: list[str], said: IO[str]) -> "subprocess.Popen[str]":
    try:
        return subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=said,
            encoding="utf-8",
            errors="replace",
            # A terminal sends Ctrl-C to the group of its foreground, and the program takes a second one as an
            # order to end at once: it gets the one that is passed on.
            start_new_session=True,
        )
    except OSError as error:
        raise ProgramError(f"cannot run `{arguments[0]}`: {error.strerror}") from error


def _stop(process: "subprocess.Popen[str]") -> None:
    process.send_signal(signal.SIGINT)
    try:
        # Reads on: a full pipe would hold the program up.
        process.communicate()
    except BaseException:
        process.kill()
        raise
