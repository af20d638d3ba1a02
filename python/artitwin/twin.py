"""Finished twins."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from .errors import ReportError
from .joint import Joint
from .mesh import Mesh
from .note import Note
from .process import StrPath
from .record import Array, load, record

FORMAT = "artitwin-report/2"
"""The layout of `report.json` that this package reads."""


@dataclass(frozen=True)
class State:
    """Position of every joint in an observed state, rad or m."""

    joints: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Grasp:
    """A place where a parallel hand can take a link, in the link's frame."""

    name: str
    position: Array
    """Between the fingertips, m, shape (3,)."""
    quaternion: Array
    """Turn of the hand, w first: x is the closing direction, z the approach."""
    width_mm: float
    off_deg: float
    seen: bool


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part."""

    name: str
    mass_kg: float
    mass_range_kg: Array
    assumption: str
    solids: int
    area_m2: float
    assumed_area_m2: float
    assumed_walls_m2: float
    vertices: int
    triangles: int
    grasps: tuple[Grasp, ...]


@dataclass(frozen=True)
class Stage:
    """Wall time of a stage."""

    name: str
    seconds: float


@dataclass(frozen=True)
class Overall:
    """One word for the result, `usable`, `usable_with_warnings` or `look_before_use`, and its reason."""

    word: str
    reason: str


@dataclass(frozen=True, eq=False)
class Twin(os.PathLike[str]):
    """A run folder of `reconstruct`. What has no field here is in `data`, all of `report.json`."""

    folder: Path
    name: str
    states: tuple[State, ...]
    joints: tuple[Joint, ...]
    links: tuple[Link, ...]
    stages: tuple[Stage, ...]
    versions: Mapping[str, str]
    seed: int
    preset: str
    config_digest: str
    device: str
    notes: tuple[Note, ...]
    warnings: tuple[Note, ...]
    """What was degraded; exit code 3."""
    data: Mapping[str, Any] = field(repr=False)
    overall: Overall | None = None
    """None in the folders of older versions."""

    @classmethod
    def read(cls, folder: StrPath) -> "Twin":
        """Reads the run folder of a finished reconstruction."""
        folder = Path(folder)
        path = folder / "report.json"
        data = load(path)
        if data.get("format") != FORMAT:
            raise ReportError(f"`{path}` is {data.get('format', 'of no known format')}, not {FORMAT}")
        return record(cls, {**data, "folder": folder, "data": data}, str(path))

    def __fspath__(self) -> str:
        return os.fspath(self.folder)

    def joint(self, name: str) -> Joint:
        """The joint of that name."""
        return {joint.name: joint for joint in self.joints}[name]

    def link(self, name: str) -> Link:
        """The link of that name."""
        return {link.name: link for link in self.links}[name]

    def visual(self, link: str) -> tuple[Mesh, ...]:
        """Meshes that show a link: what was seen, then walls that no view saw."""
        return self._meshes("visual", link)

    def collision(self, link: str) -> tuple[Mesh, ...]:
        """Convex collision solids of a link."""
        return self._meshes("collision", link)

    def _meshes(self, shape: str, link: str) -> tuple[Mesh, ...]:
        try:
            robot = ElementTree.parse(self.urdf).getroot()
        except (OSError, ElementTree.ParseError) as error:
            raise ReportError(f"cannot read `{self.urdf}`: {error}") from error
        found = robot.findall(f"./link[@name='{self.link(link).name}']/{shape}/geometry/mesh")
        return tuple(Mesh.read(self.folder / mesh.attrib["filename"]) for mesh in found)

    @property
    def urdf(self) -> Path:
        """For every simulator."""
        return self.folder / f"{self.name}.urdf"

    @property
    def mjcf(self) -> Path:
        """For MuJoCo: the twin alone."""
        return self.folder / f"{self.name}.xml"

    @property
    def scene(self) -> Path:
        """For MuJoCo: the twin on a floor, with light and camera."""
        return self.folder / "scene.xml"

    @property
    def scene_actuated(self) -> Path:
        """The scene with a position actuator a joint."""
        return self.folder / "scene_actuated.xml"

    @property
    def sdf(self) -> Path:
        """For Gazebo and Drake."""
        return self.folder / "model.sdf"

    @property
    def usd(self) -> Path:
        """UsdPhysics."""
        return self.folder / f"{self.name}.usda"

    @property
    def report(self) -> Path:
        """The page to judge the twin by."""
        return self.folder / "report.html"

    @property
    def viewer(self) -> Path:
        """The twin in a browser."""
        return self.folder / "viewer.html"
