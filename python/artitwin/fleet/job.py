"""A job: what is asked for a row, and what is known of it before and after."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, field

from ..note import Note
from .inputs import RECORDING, TWIN, TWIN_WITH_MESHES
from .store import as_uri
from .summary import Summary
from .table import Row

_READ = ("--frames", "--held-out")
"""Options that name recordings: inputs like those of the row."""
_PATHS = ("--config", "--matcher", "--stages")
"""Options that name what every node has."""


@dataclass(frozen=True)
class Job:
    """What a worker needs to run a row."""

    command: str
    row: Row
    out: str
    program: str | None
    """None: the program of the node's own package."""
    folder: str
    """From where relative paths in options count."""
    scratch: str | None
    limit_s: float | None

    def inputs(self) -> list[tuple[str, str]]:
        """URI of each input, and what is read of it: those of the row, then those of its options."""
        options = [value for name, value in self._options() if name in _READ]
        more = [(as_uri(value, as_uri(self.folder)), RECORDING) for value in options]
        if self.command == "reconstruct":
            return [*((uri, RECORDING) for uri in self.row.inputs), *more]
        has_frames = any(name == "--frames" for name, _ in self._options())
        twin = (self.row.inputs[0], TWIN_WITH_MESHES if has_frames else TWIN)
        return [twin, *((uri, RECORDING) for uri in self.row.inputs[1:]), *more]

    def arguments(self, paths: Iterable[str]) -> list[str]:
        """Options and inputs of the command line; `paths` are where `inputs` are on this machine."""
        given = list(paths)
        own = given[: len(self.row.inputs)]
        more = iter(given[len(self.row.inputs) :])
        words = []
        for name, value in self._options():
            if name in _READ:
                words.append(f"{name}={next(more)}")
            elif name in _PATHS:
                words.append(f"{name}={os.path.join(self.folder, value)}")
            else:
                words.append(name)
        return [*words, "--", *own]

    def _options(self) -> list[tuple[str, str]]:
        """Options that name a path with it, in one word or two; all other words with nothing."""
        found: list[tuple[str, str]] = []
        words = iter(self.row.options)
        for word in words:
            name, equals, value = word.partition("=")
            if name in (*_READ, *_PATHS):
                found.append((name, value if equals else next(words, "")))
            else:
                found.append((word, ""))
        return found


@dataclass(frozen=True)
class Estimate:
    """What a job will need, and what it is."""

    key: str
    """A digest of all that determines the result: inputs, settings, name and version of the program."""
    cores: float
    memory_bytes: int
    seconds: float
    scratch_bytes: int = 0
    bytes_stored: int = 0
    bytes_read: int = 0
    name: str = ""
    version: str = ""
    listed: str = ""
    """A digest of how the inputs were found."""
    identities: tuple[str, ...] = ()
    """What the key holds of each input."""


@dataclass(frozen=True)
class Transfer:
    """What went over the network."""

    bytes_stored: int = 0
    bytes_read: int = 0
    bytes_written: int = 0
    requests: int = 0
    retries: int = 0
    seconds: float = 0.0


@dataclass(frozen=True)
class Manifest:
    """A finished job; keys that have no field are passed over."""

    key: str
    status: str
    """`done`, `degraded` or `refused`."""
    exit_code: int
    message: str | None
    folder: str | None
    name: str = ""
    warnings: tuple[Note, ...] = ()
    version: str = ""
    transfer: Transfer = field(default_factory=Transfer)
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_memory_bytes: int = 0
    started: str = ""


@dataclass(frozen=True)
class Outcome:
    """How an attempt ended: with a manifest; `lost`, to be tried again; or refused without one."""

    exit_code: int
    message: str
    seconds: float
    manifest: Manifest | None = None
    summary: Summary | None = None
    lost: bool = False
    out_of_memory: bool = False
    """It may have been."""
    stopped: bool = False


@dataclass(frozen=True)
class Look:
    """What is known of a row before it is run."""

    estimate: Estimate | None
    message: str
    """Why there is no estimate."""
    outcome: Outcome | None = None
    """What stands already, or a refusal."""
