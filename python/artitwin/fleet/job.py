"""A job: the plain command for one row, run on this machine, and what became of it."""

import json
import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import ReportError
from ..note import Note
from ..process import program
from ..record import record
from . import child
from .leash import NOT_STARTED
from .store import Store, StoreError, as_input
from .summary import Summary, summary
from .table import Row

JOB = "artitwin-job/1"
ESTIMATE = "artitwin-estimate/1"
TEMPORARY = 75
"""Exit code of what may pass (EX_TEMPFAIL of sysexits.h)."""
STOPPED = 130
_MOST_MANIFEST = 16 << 20
"""A manifest of 1000 files has under 1 MB."""


@dataclass(frozen=True)
class Job:
    """What a worker needs to run a row."""

    command: str
    row: Row
    out: str
    program: str | None
    """None: the program of the node's own package."""
    folder: str
    """Where it runs, if that folder is there."""
    scratch: str | None
    limit_s: float | None

    def arguments(self, estimate: bool = False) -> list[str]:
        """The command line behind the program."""
        return [
            self.command,
            *(["--estimate"] if estimate else []),
            "--json",
            f"--out={self.out}",
            *([f"--name={self.row.name}"] if self.row.name else []),
            *([f"--scratch={self.scratch}"] if self.scratch else []),
            *self.row.options,
            "--",
            *(as_input(uri) for uri in self.row.inputs),
        ]

    def line(self) -> str:
        """The same for a person, to run by hand."""
        return shlex.join(["artitwin", *self.arguments()])


@dataclass(frozen=True)
class Estimate:
    """What a job will need; `done` is the status of a manifest that stands."""

    key: str | None
    done: str | None
    cores: float
    memory_bytes: int
    seconds: float
    scratch_bytes: int = 0
    bytes_stored: int = 0
    bytes_read: int = 0


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
    """What stands already."""


def look(job: Job) -> Look:
    """Estimates a job; where its manifest stands, reads that."""
    ended = _run(job, job.arguments(estimate=True), {})
    if ended.exit_code != 0:
        return Look(None, ended.message or f"exit code {ended.exit_code}")
    try:
        value = json.loads(ended.last_line)
        if value.get("format") != ESTIMATE:
            return Look(None, f"an estimate of format {value.get('format')}, not {ESTIMATE}")
        estimate = record(Estimate, value, "estimate")
    except (ValueError, AttributeError, ReportError) as error:
        return Look(None, f"no estimate that this package reads: {error}")
    if estimate.done is None or estimate.key is None:
        return Look(estimate, "")
    try:
        data = Store(job.out).read(f"{estimate.key}.json", _MOST_MANIFEST)
        return Look(estimate, "", data and _finished(json.loads(data), job, 0.0) or None)
    except (StoreError, ValueError, ReportError):
        # The job reads it once more, or writes it anew.
        return Look(estimate, "")


def work(job: Job, cores: int) -> Outcome:
    """Runs a job to its end."""
    # The program uses all cores that it sees; its results do not depend on their number.
    ended = _run(job, job.arguments(), {"RAYON_NUM_THREADS": str(max(1, cores))})
    code = ended.exit_code
    if ended.overtime:
        return Outcome(code, f"stopped after {ended.seconds:.0f} s", ended.seconds, lost=True)
    try:
        value = json.loads(ended.last_line) if ended.last_line.startswith("{") else {}
        if value.get("format") == JOB:
            return _finished(value, job, ended.seconds)
    except (ValueError, ReportError) as error:
        return Outcome(code, f"a result that this package does not read: {error}", ended.seconds)
    message = ended.message.rpartition("error: ")[2] or f"exit code {code}"
    if code in (1, 2, NOT_STARTED):
        # A refusal before there was a key.
        return Outcome(code, message, ended.seconds)
    if code == STOPPED:
        return Outcome(code, "stopped", ended.seconds, lost=True, stopped=True)
    if code < 0 or code > 128:
        number = -code if code < 0 else code - 128
        return Outcome(code, f"ended by signal {number}", ended.seconds, lost=True, out_of_memory=number == 9)
    return Outcome(code, message, ended.seconds, lost=True)


def _run(job: Job, arguments: list[str], environment: Mapping[str, str]) -> child.Ended:
    folder = job.folder if os.path.isdir(job.folder) else None
    named = os.path.abspath(job.program or program())
    return child.run([named, *arguments], environment, folder, job.limit_s)


def _finished(value: Any, job: Job, seconds: float) -> Outcome:
    if not isinstance(value, dict) or value.get("format") != JOB:
        raise ReportError(f"a manifest that is not {JOB}")
    manifest = record(Manifest, value, "manifest")
    read = summary(Store(job.out), manifest.folder, job.command) if manifest.folder else None
    return Outcome(manifest.exit_code, manifest.message or "", seconds, manifest, read)
