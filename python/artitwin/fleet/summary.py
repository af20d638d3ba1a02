"""What a table of a fleet keeps of a report: a few hundred bytes of it."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .store import Store, StoreError

_MOST_REPORT = 64 << 20
"""measured: report.json of an object has 20 KB, of a diagnosis up to 1 MB."""


@dataclass(frozen=True)
class Joint:
    """A joint with its stated deviations; None where a number is not determined."""

    name: str
    type: str
    axis: tuple[float, ...]
    origin: tuple[float, ...]
    motion: float | None
    unit: str
    axis_std_deg: float | None
    origin_std_mm: float | None
    motion_std: float | None


@dataclass(frozen=True)
class Parameter:
    """A number of an effect with its 95 % interval."""

    name: str
    value: float | None
    unit: str
    lower: float | None
    upper: float | None


@dataclass(frozen=True)
class Named:
    """An effect that a diagnosis names."""

    joint: str
    effect: str
    weight: float | None
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Summary:
    """Of a twin: parts and joints. Of a diagnosis: verdict and findings."""

    parts: int = 0
    joints: tuple[Joint, ...] = ()
    overall: str = ""
    verdict: str = ""
    findings: tuple[Named, ...] = ()
    doubts: tuple[str, ...] = ()
    """Joints that are not diagnosed, with the code of why."""
    gap_before: float | None = None
    gap_after: float | None = None
    noise_floor: float | None = None


def summary(store: Store, folder: str, command: str) -> Summary | None:
    """Of the result in a folder of the store; None where its report cannot be read."""
    try:
        data = store.read(f"{folder}/report.json", _MOST_REPORT)
        report = json.loads(data) if data is not None else None
        if not isinstance(report, dict):
            return None
        return _of_twin(report) if command == "reconstruct" else _of_diagnosis(report)
    except (StoreError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _of_twin(report: Mapping[str, Any]) -> Summary:
    overall = report.get("overall") or {}
    joints = tuple(_joint(joint) for joint in report.get("joints", ()))
    return Summary(parts=len(report.get("links", ())), joints=joints, overall=str(overall.get("word", "")))


def _joint(value: Mapping[str, Any]) -> Joint:
    motion, deviation = value.get("motion") or {}, value.get("motion_std") or {}
    return Joint(
        name=str(value["name"]),
        type=str(value["type"]),
        axis=tuple(float(x) for x in value["axis"]),
        origin=tuple(float(x) for x in value["origin"]),
        motion=_number(motion.get("value")),
        unit=str(motion.get("unit", "")),
        axis_std_deg=_number(value.get("axis_std_deg")),
        origin_std_mm=_number(value.get("origin_std_mm")),
        motion_std=_number(deviation.get("value")),
    )


def _of_diagnosis(report: Mapping[str, Any]) -> Summary:
    gap = report.get("gap") or {}
    return Summary(
        verdict=str(report["verdict"]),
        findings=tuple(_named(finding) for finding in report.get("findings", ())),
        doubts=tuple(f"{doubt['joint']}: {doubt['code']}" for doubt in report.get("doubts", ())),
        gap_before=_number(gap.get("before")),
        gap_after=_number(gap.get("after")),
        noise_floor=_number(gap.get("noise_floor")),
    )


def _named(value: Mapping[str, Any]) -> Named:
    parameters = tuple(
        Parameter(
            str(p["name"]),
            _number(p.get("value")),
            str(p.get("unit", "")),
            *(_number(end) for end in (p.get("interval") or (None, None))),
        )
        for p in value.get("parameters", ())
    )
    return Named(str(value["joint"]), str(value["effect"]), _number(value.get("weight")), parameters)


def _number(value: Any) -> float | None:
    number = float("nan") if value is None else float(value)
    return number if math.isfinite(number) else None
