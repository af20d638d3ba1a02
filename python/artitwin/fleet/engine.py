"""What the schedule asks of a scheduler; Ray is one (`cluster.py`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from .job import Job, Look, Outcome


@dataclass(frozen=True)
class Size:
    """What a cluster has now."""

    cpus: float
    nodes: int
    largest_cpus: float
    largest_memory: int


@dataclass(frozen=True)
class Start:
    """A worker began an attempt at a row."""

    number: int
    attempt: int
    at: float
    """Seconds since 1970, by the clock of the fleet's machine."""
    node: str
    pid: int


class Engine(Protocol):
    """Runs tasks. Handles are opaque and hashable."""

    def look(self, job: Job) -> Any:
        """Estimates a job on some worker."""

    def submit(self, job: Job, known: Look | None, attempt: int, cores: float, memory: int) -> Any:
        """Queues a job, with what a look found, for a worker with these cores and bytes free."""

    def wait(self, handles: Sequence[Any], timeout_s: float) -> list[tuple[Any, Look | Outcome]]:
        """Those that ended, after all did or the time is over."""

    def starts(self) -> list[Start]:
        """What began since the last call."""

    def cancel(self, handle: Any) -> None:
        """Asks a job to stop; one that waits does not begin."""

    def size(self) -> Size:
        """What the cluster has now."""
