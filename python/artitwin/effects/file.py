"""`effects.json` as dataclasses (docs/effects.md)."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from ..errors import ReportError
from ..process import StrPath
from ..record import load, record

LAYOUT = "artitwin-effects/1"
"""The layout that this package reads."""

_UNIT = re.compile(
    r"_(Nm?(s2?)?(_per_(rad|m)[23]?)?|(rad|m)(_per_(s|rad|m))?|kg(m2)?|s)$",
)


@dataclass(frozen=True)
class Effect:
    """An effect with its parameters, whose names end in their units."""

    name: str = field(metadata={"key": "effect"})
    parameters: Mapping[str, float]
    end: str | None = None
    """`upper` or `lower`, where a stop stands."""
    other_joint: str | None = None
    """The other joint of a coupling."""
    run: str | None = None
    """The only run in which it acted."""

    @cached_property
    def numbers(self) -> dict[str, float]:
        """The parameters by their names without units."""
        return {_UNIT.sub("", key): value for key, value in self.parameters.items()}


@dataclass(frozen=True)
class HeldEffects:
    """The effects of a joint in a file, which stand in for those that were found."""

    format: str
    file: str
    holds: tuple[Effect, ...]


@dataclass(frozen=True)
class JointLaw:
    """The effects of a joint."""

    joint: str
    type: str
    """`revolute` (rad, N m) or `prismatic` (m, N)."""
    settle_time_s: float
    """Time in which friction brings the joint to rest; 0 is at once."""
    creep_share: float
    """Share of the other efforts that still moves a joint held by friction with a settle time."""
    twin: tuple[Effect, ...]
    """Damping and friction of the twin, which every file holds."""
    effects: tuple[Effect, ...]
    """What was found."""
    files: tuple[HeldEffects, ...]

    def held_by(self, file: str) -> tuple[Effect, ...]:
        """The effects in a file of the folder; none in a file that is not listed."""
        return next((held.holds for held in self.files if held.file == file), ())


@dataclass(frozen=True)
class _File:
    format: str
    joints: tuple[JointLaw, ...]


def read_laws(path: StrPath) -> tuple[JointLaw, ...]:
    """The effects of all joints in an `effects.json`."""
    path = Path(path)
    data = load(path)
    if data.get("format") != LAYOUT:
        raise ReportError(f"`{path}` has the layout {data.get('format')!r}; this package reads {LAYOUT!r}")
    return record(_File, data, str(path)).joints
