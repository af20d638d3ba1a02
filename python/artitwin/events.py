"""What a running reconstruction reports (docs/commands.md, Events)."""

import json
from dataclasses import dataclass

from .record import record


@dataclass(frozen=True)
class PlannedStage:
    """A stage that is to come, and its share of the time against the others'."""

    stage: str
    weight: float


@dataclass(frozen=True)
class Planned:
    """Stages are to come, or weigh other than it was said before."""

    stages: tuple[PlannedStage, ...]


@dataclass(frozen=True)
class StageStarted:
    """A stage began; `steps` is how many it will take, where known."""

    stage: str
    steps: int | None


@dataclass(frozen=True)
class Step:
    """A step of a stage was done."""

    stage: str
    done: int
    total: int
    loss: float


@dataclass(frozen=True)
class Count:
    """A part of a stage without a loss was done."""

    stage: str
    done: int
    total: int


@dataclass(frozen=True)
class StageFinished:
    """A stage ended."""

    stage: str
    seconds: float


@dataclass(frozen=True)
class Warned:
    """The result is degraded."""

    code: str
    message: str


@dataclass(frozen=True)
class Noted:
    """Something to know."""

    code: str
    message: str


@dataclass(frozen=True)
class Artifact:
    """The run folder is in its place."""

    path: str


@dataclass(frozen=True)
class Failed:
    """The run ended without a result; the last event."""

    message: str
    exit_code: int


Event = Planned | StageStarted | Step | Count | StageFinished | Warned | Noted | Artifact | Failed

_KINDS: dict[str, type[Event]] = {
    "planned": Planned,
    "stage_started": StageStarted,
    "step": Step,
    "count": Count,
    "stage_finished": StageFinished,
    "warning": Warned,
    "note": Noted,
    "artifact": Artifact,
    "error": Failed,
}


def event(line: str) -> Event | None:
    """The event of a line of `--json`; None for one of a kind that this package does not know."""
    value = json.loads(line)
    kind = _KINDS.get(value["event"])
    return None if kind is None else record(kind, value, value["event"])
