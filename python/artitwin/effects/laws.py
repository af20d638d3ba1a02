"""The equations of all effects, those of src/gap/model/effects, as pure functions.

Three kinds of effects are forces: efforts, stops, and bounds of friction. The others change what a joint is
given or what is read of it: gain and delay the command; scale, offset and play the position; inertia what the
efforts move.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

Numbers = Mapping[str, float]
"""Parameters of an effect, by their names without units."""


class State(NamedTuple):
    """State of a joint: rad, rad/s and N m, of a sliding joint m, m/s and N."""

    position: float
    """True position, without errors of a sensor."""
    velocity: float
    drive: float = 0.0
    """Effort of the drive."""
    load: float = 0.0
    """Sum of all smooth efforts on the joint, the drive's among them; only stops read it."""
    other: float = 0.0
    """Position of the other joint of a coupling, rad or m."""
    time_s: float = 0.0
    direction: float = 1.0
    """What friction opposes: the sign of the velocity, or at rest that of the coming motion."""


def _viscous_friction(p: Numbers, s: State) -> float:
    return -p["damping"] * s.velocity


def _quadratic_drag(p: Numbers, s: State) -> float:
    return -p["drag"] * s.velocity * abs(s.velocity)


def _constant_bias(p: Numbers, s: State) -> float:
    return p["effort"]


def _spring_return(p: Numbers, s: State) -> float:
    return p["offset"] - p["stiffness"] * s.position


def _hardening_spring(p: Numbers, s: State) -> float:
    x = s.position - p["rest_position"]
    return -p["stiffness"] * x - p["hardening"] * x**3


def _axis_tilt(p: Numbers, s: State) -> float:
    return p["sine"] * math.sin(s.position) + p["cosine"] * math.cos(s.position)


def _cogging(p: Numbers, s: State) -> float:
    phase = p["wave_number"] * s.position
    return p["sine"] * math.sin(phase) + p["cosine"] * math.cos(phase)


def _detent(p: Numbers, s: State) -> float:
    x = (s.position - p["position"]) / p["width"]
    return -p["effort"] * x * math.exp(0.5 * (1.0 - x * x))


def _coupling(p: Numbers, s: State) -> float:
    return p["offset"] - p["stiffness"] * s.position + p["other_stiffness"] * s.other


def _disturbance(p: Numbers, s: State) -> float:
    x = (s.time_s - p["time"]) / p["duration"]
    return p["effort"] * math.exp(-0.5 * x * x)


def _coulomb_friction(p: Numbers, s: State) -> float:
    return p["friction"]


def _asymmetric_friction(p: Numbers, s: State) -> float:
    return p["friction_negative"] if s.direction < 0.0 else p["friction_positive"]


def _stribeck_friction(p: Numbers, s: State) -> float:
    return p["friction"] + p["breakaway_excess"] * math.exp(-((s.velocity / p["stribeck_velocity"]) ** 2))


def _load_dependent_friction(p: Numbers, s: State) -> float:
    return p["coefficient"] * abs(s.drive)


def _local_friction(p: Numbers, s: State) -> float:
    return p["friction"] * math.exp(-(((s.position - p["position"]) / p["width"]) ** 2))


def stop_effort(p: Numbers, s: State, side: float) -> float:
    """Effort of a stop, N m or N; `side` is 1 at the upper end of the range and -1 at the lower."""
    depth = side * (s.position - p["position"])
    if depth <= 0.0:
        return 0.0
    push = p["stiffness"] * depth + p["contact_damping"] * side * s.velocity + p["impedance"] * side * s.load
    # A stop never pulls.
    return -side * max(push, 0.0)


EFFORTS: dict[str, Callable[[Numbers, State], float]] = {
    "axis_tilt": _axis_tilt,
    "cogging": _cogging,
    "constant_bias": _constant_bias,
    "coupling": _coupling,
    "detent": _detent,
    "disturbance": _disturbance,
    "hardening_spring": _hardening_spring,
    "quadratic_drag": _quadratic_drag,
    "spring_return": _spring_return,
    "viscous_friction": _viscous_friction,
}
"""Smooth efforts, N m or N."""

STOP = "end_stop"
"""The effect of `stop_effort`."""

FRICTIONS: dict[str, Callable[[Numbers, State], float]] = {
    "asymmetric_friction": _asymmetric_friction,
    "coulomb_friction": _coulomb_friction,
    "load_dependent_friction": _load_dependent_friction,
    "local_friction": _local_friction,
    "stribeck_friction": _stribeck_friction,
}
"""Bounds of the friction, N m or N: at rest it takes up to this, in motion it is this."""

SCALARS = {
    "delay": "delay",
    "encoder_bias": "offset",
    "encoder_scale": "scale",
    "backlash": "half_gap",
    "inertia": "added_inertia",
    "torque_gain": "gain",
}
"""Effects that are no forces, each with its one parameter."""


def followed(gauge: float, position: float, half_gap: float) -> float:
    """Where a sensor behind a play stands that stood at `gauge`, once the joint is at `position`."""
    return min(max(gauge, position - half_gap), position + half_gap)


def friction_effort(
    state: State,
    total: float,
    bound: float,
    bound_at_turn: float,
    inertia: float,
    step_s: float,
    settle_time_s: float,
    creep_share: float,
) -> float:
    """Effort of friction over one step, N m or N, for simulators without friction of joints.

    `total` is the sum of all other efforts. Within `bound` friction brings the joint to rest: in this step,
    or in `settle_time_s`, in which the share `creep_share` of the other efforts goes on moving it. Where the
    joint would turn around, `bound_at_turn` of the other direction may hold it.
    """
    kick = step_s / inertia
    free = state.velocity + kick * total
    if free * state.direction < 0.0:
        bound = bound_at_turn if state.velocity == 0.0 else max(bound, bound_at_turn)
    keep = creep = 0.0
    if settle_time_s > 0.0:
        keep = math.exp(-step_s / settle_time_s)
        creep = creep_share * settle_time_s * (1.0 - keep) / step_s
    # What takes the free velocity to that of a joint held by friction.
    wanted = (keep * state.velocity + creep * kick * total - free) / kick
    return min(max(wanted, -bound), bound)
