"""Joints of a twin with what is known about them, as in `report.json`."""

from collections.abc import Mapping
from dataclasses import dataclass

from .note import Note
from .record import Array


@dataclass(frozen=True)
class Quantity:
    """A number with its unit, rad or m; NaN where it is not determined."""

    value: float
    unit: str


@dataclass(frozen=True)
class Position:
    """Position in a state, rad or m; `std` is None where it is not known."""

    state: int
    value: float
    std: float | None


@dataclass(frozen=True)
class Closed:
    """Where a face of the part meets its seat, rad or m."""

    position: float
    std: float
    contact_share: float


@dataclass(frozen=True, eq=False)
class Limit:
    """Interval of positions, rad or m; `effort` in N m or N, `velocity` in rad/s or m/s."""

    lower: float
    upper: float
    effort: float
    velocity: float
    source: str
    """`seated`, `observed` or `swept`."""
    observed: Array
    """Lowest and highest observed position."""
    swept: Array | None
    """Interval without collision."""
    closed: Closed | None


@dataclass(frozen=True)
class Dynamics:
    """Friction (N m or N) and damping (N m s/rad or N s/m), and what both rest on."""

    friction: float
    damping: float
    assumption: str


@dataclass(frozen=True, eq=False)
class AxisAlone:
    """The axis by the motion alone, where other axes and flat faces had a say."""

    axis: Array
    std_deg: float | None


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint. Axis and origin stand in the world in state 0."""

    name: str
    type: str
    """`revolute`, `prismatic`, `screw`, or `free` where no type explains the motion."""
    parent: str
    child: str
    axis: Array
    """Unit direction, shape (3,)."""
    origin: Array
    """A point on the axis, m, shape (3,)."""
    motion: Quantity
    """Position in state 1 less that in state 0; of more states that of the one farthest from state 0."""
    positions: tuple[Position, ...]
    limit: Limit
    dynamics: Dynamics
    axis_std_deg: float | None
    origin_std_mm: float | None
    motion_std: Quantity
    covariance: Array
    """Of axis (3), origin (3) and motion (1), m and rad, shape (7, 7)."""
    inliers: int
    tried: int
    residual_rms_mm: float
    type_scores: Mapping[str, float]
    """Cost of every type (Bayesian information criterion); lower is better."""
    cautions: tuple[Note, ...]
    not_observable: tuple[Note, ...]
    pitch_m_per_rad: float | None = None
    pitch_std_m_per_rad: float | None = None
    axis_alone: AxisAlone | None = None
