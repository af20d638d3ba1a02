"""Which machines of a fleet drift from their twin, by which effect, since when.

A log of a machine says of an effect at a joint: it is `named`; it is `absent` (the log was diagnosed and does
not need it); or nothing, since the log has no verdict (`silent`: refused, failed, insufficient, the joint
doubted) or leaves it open (`open`: ambiguous or unknown). The effect is there *since* the first log that names
it after the last log in which it is absent. It began between these two; what lies between and says nothing
widens that span, and is counted.
"""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from .stragglers import student

_LEVEL = 0.05
"""Chance of one machine that is set apart by its value alone though all are alike; the usual level of a test."""
_NORMAL_MAD = 1.4826
"""derived: deviation of a normal over its median absolute deviation."""
_TWO_SIDED_95 = 1.96
"""derived: half a 95 % interval of a normal over its deviation."""
_MOST = 0.5
"""derived: an effect that more machines have than have not is the twin's."""
_LEAST_MACHINES = 3
"""derived: of fewer no majority differs from all."""


@dataclass(frozen=True)
class Point:
    """A parameter of a named effect in a log."""

    time: float
    log: int
    """Its row."""
    parameter: str
    value: float
    lower: float | None
    upper: float | None
    unit: str


@dataclass(frozen=True)
class Drift:
    """An effect that the last logs of a machine name."""

    machine: str
    joint: str
    effect: str
    since: float
    """Time of the first log of the last unbroken row that names it."""
    after: float | None
    """Time of the last log in which it was absent; None: it is older than the machine's logs."""
    named: int
    """Logs that name it since."""
    silent: int
    """Logs after `after` that say nothing."""
    open: int
    """Logs after `after` that leave it open."""
    earlier: int
    """Logs before `after` that named it: it came and went."""
    points: tuple[Point, ...]
    share: float = 0.0
    """Machines whose last logs name it, of those with a verdict."""
    apart: float | None = None
    """How far its last value is from the machines' median, in deviations; None: too few to say."""
    is_apart: bool = False
    has_grown: bool | None = None
    """The intervals of the first and last value do not overlap; None: one log."""
    doubts: tuple[str, ...] = field(default=())
    is_of_twin: bool = False
    """Most machines have it: the twin lacks it, rather than this machine drifted."""


def drifts(rows: Iterable[Mapping[str, Any]]) -> list[Drift]:
    """Of the rows of a fleet's table of logs; sorted by machine, joint and effect."""
    machines: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        machines.setdefault(str(row.get("machine") or row["name"]), []).append(row)
    found = []
    with_verdict = 0
    for machine in sorted(machines):
        # Without times the order of the table.
        logs = sorted(machines[machine], key=lambda row: (_time(row), row["row"]))
        with_verdict += any(not _is_silent(row) for row in logs)
        named = {(f["joint"], f["effect"]) for row in logs for f in _findings(row)}
        found += [d for joint, effect in sorted(named) if (d := _drift(machine, logs, joint, effect))]
    return _compared(found, with_verdict)


def _time(row: Mapping[str, Any]) -> float:
    return float(row["row"] if row.get("time") is None else row["time"])


def _findings(row: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    return row.get("findings") or () if row.get("verdict") in ("named", "ambiguous") else ()


def _is_silent(row: Mapping[str, Any]) -> bool:
    return row.get("status") not in ("done", "degraded") or row.get("verdict") in (None, "", "insufficient")


def _says(row: Mapping[str, Any], joint: str, effect: str) -> str:
    if _is_silent(row) or any(doubt.startswith(f"{joint}: ") for doubt in row.get("doubts") or ()):
        return "silent"
    names = any(f["joint"] == joint and f["effect"] == effect for f in _findings(row))
    if row["verdict"] == "ambiguous":
        return "open" if names or not any(f["joint"] == joint for f in _findings(row)) else "absent"
    if names:
        return "named"
    return "open" if row["verdict"] == "unknown" else "absent"


def _drift(machine: str, logs: Sequence[Mapping[str, Any]], joint: str, effect: str) -> Drift | None:
    says = [_says(row, joint, effect) for row in logs]
    last_absent = max((k for k, word in enumerate(says) if word == "absent"), default=-1)
    tail = list(zip(logs, says, strict=True))[last_absent + 1 :]
    named = [row for row, word in tail if word == "named"]
    if not named:
        return None
    points = tuple(point for row in named for point in _points(row, joint, effect))
    drift = Drift(
        machine,
        joint,
        effect,
        since=_time(named[0]),
        after=_time(logs[last_absent]) if last_absent >= 0 else None,
        named=len(named),
        silent=sum(word == "silent" for _, word in tail),
        open=sum(word == "open" for _, word in tail),
        earlier=says[: last_absent + 1].count("named"),
        points=points,
        has_grown=_has_grown(points),
    )
    timed = all(row.get("time") is not None for row in logs)
    return replace(drift, doubts=_doubts(drift, timed))


def _points(row: Mapping[str, Any], joint: str, effect: str) -> list[Point]:
    return [
        Point(
            _time(row), row["row"], p["name"], p["value"], p.get("lower"), p.get("upper"), p.get("unit") or ""
        )
        for finding in _findings(row)
        if finding["joint"] == joint and finding["effect"] == effect
        for p in finding.get("parameters") or ()
        if p.get("value") is not None
    ]


def main_points(drift: Drift) -> list[Point]:
    """Those of the effect's first parameter."""
    return [p for p in drift.points if p.parameter == drift.points[0].parameter]


def _has_grown(points: Sequence[Point]) -> bool | None:
    own = [p for p in points if p.parameter == points[0].parameter]
    if len(own) < 2:
        return None
    first, last = own[0], own[-1]
    ends = (first.lower, first.upper, last.lower, last.upper)
    if any(end is None for end in ends):
        return None
    a_low, a_high, b_low, b_high = (float(end) for end in ends if end is not None)
    return b_low > a_high or b_high < a_low


def _doubts(drift: Drift, timed: bool) -> tuple[str, ...]:
    said = []
    if drift.named == 1:
        said.append("one log alone names it")
    if drift.after is None:
        said.append("it may be older than the first log")
    if drift.silent or drift.open:
        said.append(f"of {_logs(drift.silent + drift.open)} among these nothing is known")
    if drift.earlier:
        said.append(f"named before by {_logs(drift.earlier)}, then absent")
    if not timed:
        said.append("logs without a time: their order is that of the table")
    return tuple(said)


def _logs(count: int) -> str:
    return "1 log" if count == 1 else f"{count} logs"


def _compared(found: Sequence[Drift], machines: int) -> list[Drift]:
    """With how many machines have the same, and how far their values are apart."""
    groups: dict[tuple[str, str], list[Drift]] = {}
    for drift in found:
        groups.setdefault((drift.joint, drift.effect), []).append(drift)
    compared = []
    for drift in found:
        group = groups[drift.joint, drift.effect]
        apart = _apart(drift, group)
        limit = student(1.0 - _LEVEL / (2.0 * machines), len(group) - 1) if len(group) > 2 else math.inf
        share = len(group) / machines if machines else 0.0
        is_apart = apart is not None and abs(apart) > limit
        of_twin = machines >= _LEAST_MACHINES and share > _MOST
        compared.append(replace(drift, share=share, apart=apart, is_apart=is_apart, is_of_twin=of_twin))
    return compared


def _apart(drift: Drift, group: Sequence[Drift]) -> float | None:
    last = {d.machine: main_points(d)[-1] for d in group if d.points}
    if len(last) < 3 or drift.machine not in last:
        return None
    values = [point.value for point in last.values()]
    middle = statistics.median(values)
    spread = _NORMAL_MAD * statistics.median(abs(value - middle) for value in values)
    own = last[drift.machine]
    half = (own.upper - own.lower) / 2.0 if own.upper is not None and own.lower is not None else 0.0
    deviation = math.hypot(spread, half / _TWO_SIDED_95)
    return (own.value - middle) / deviation if deviation > 0.0 else None
