"""Finished diagnoses, as in `report.json`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .errors import ReportError
from .note import Note
from .process import StrPath
from .record import Array, load, record


@dataclass(frozen=True, eq=False)
class Parameter:
    """A number of an effect with its 95 % interval, shape (2,). `open` is why the runs leave it open: `at_bound` or
    `wide`; what is not finite is then nan."""

    name: str
    value: float
    unit: str
    interval: Array
    open: str | None = None


@dataclass(frozen=True)
class Alternative:
    """Another effect that these runs cannot rule out, and the recording that would."""

    effect: str
    weight: float
    experiment: str


@dataclass(frozen=True)
class TypeChange:
    """Type of a joint in the twin, and as the frames show it."""

    twin: str = field(metadata={"key": "from"})
    frames: str = field(metadata={"key": "to"})


@dataclass(frozen=True)
class Finding:
    """An effect that the twin lacks at a joint."""

    joint: str
    effect: str
    parameters: tuple[Parameter, ...]
    weight: float
    alternatives: tuple[Alternative, ...]
    type: TypeChange | None = None


@dataclass(frozen=True, eq=False)
class Region:
    """Where the twin and the runs disagree: an interval of a variable, or a box of a part's surface."""

    joint: str
    variable: str
    region: Array
    p: float | None = None
    residual_before_m: float | None = None
    residual_after_m: float | None = None


@dataclass(frozen=True)
class RunGap:
    """Root mean square residual of a held-out run under the twin and under the updated twin, by windows and
    over its full length."""

    run: str
    joint: str
    unit: str
    before: float
    after: float
    full_length_before: float | None = None
    full_length_after: float | None = None


@dataclass(frozen=True)
class Gap:
    """The same over all held-out runs, of the joint with the largest gap; None where nothing is proven."""

    before: float | None
    after: float | None
    noise_floor: float | None
    unit: str | None
    runs: tuple[RunGap, ...]


@dataclass(frozen=True)
class Nearest:
    """What comes nearest under `unknown`, and explains too little to be a finding."""

    joint: str
    effects: tuple[Finding, ...]
    before: float
    after: float


@dataclass(frozen=True)
class Remainder:
    """What named effects leave and is no noise."""

    joint: str
    share_of_gap: float
    times_noise: float


@dataclass(frozen=True)
class Actuator:
    """What was found of a servo, or of efforts without a known unit."""

    joint: str
    kind: str
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Doubt:
    """A joint that is not diagnosed, since twin and recording do not mean the same by their numbers."""

    joint: str
    code: str
    looks: tuple[str, ...]
    remedy: str


@dataclass(frozen=True)
class Export:
    """What the file of a format holds of an effect (docs/diagnosis.md)."""

    format: str
    file: str
    joint: str
    effect: str
    status: str
    rmse: float | None = None
    before: float | None = None


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """A result folder of `diagnose`. What has no field here is in `data`, all of `report.json`."""

    folder: Path
    verdict: str
    """`none`, `named`, `ambiguous`, `unknown` or `insufficient`."""
    findings: tuple[Finding, ...]
    nearest: tuple[Nearest, ...]
    where: tuple[Region, ...]
    gap: Gap
    exports: tuple[Export, ...]
    warnings: tuple[Note, ...]
    data: Mapping[str, Any] = field(repr=False)
    unsure: tuple[Finding, ...] = ()
    """Effects that the files hold and that may as well be absent."""
    remainder: tuple[Remainder, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[Note, ...] = ()

    @classmethod
    def read(cls, folder: StrPath) -> "Diagnosis":
        """Reads the result folder of a finished diagnosis."""
        folder = Path(folder)
        path = folder / "report.json"
        data = load(path)
        if "format" in data or "verdict" not in data:
            raise ReportError(f"`{path}` is no report of a diagnosis that this package knows")
        return record(cls, {**data, "folder": folder, "data": data}, str(path))

    @property
    def urdf(self) -> Path:
        """The updated twin."""
        return self.folder / "twin.urdf"

    @property
    def mjcf(self) -> Path | None:
        """The updated twin for MuJoCo, without meshes; a diagnosis by frames alone has none."""
        return self._beside("twin.xml")

    @property
    def sdf(self) -> Path | None:
        """The updated `model.sdf` of a twin in a run folder."""
        return self._beside("model.sdf")

    @property
    def usd(self) -> Path | None:
        """The updated `twin.usda` of a twin in a run folder."""
        return self._beside("twin.usda")

    @property
    def report(self) -> Path:
        """The page with pictures."""
        return self.folder / "report.html"

    def _beside(self, name: str) -> Path | None:
        # With runs and frames both, the files of the motion have a folder of their own.
        places = (self.folder / name, self.folder / "motion" / name)
        return next((path for path in places if path.is_file()), None)
