"""The effects of a joint that a simulator's file lacks."""

import bisect
import math
from pathlib import Path

from ..errors import ReportError
from ..process import StrPath
from .file import Effect, JointLaw, read_laws
from .laws import EFFORTS, FRICTIONS, SCALARS, STOP, State, followed, friction_effort, stop_effort


class JointEffects:
    """What the file of a simulator lacks of a joint's effects, so that none acts twice.

    Positions and velocities are rad and rad/s, efforts N m; of a sliding joint m, m/s and N. An object
    belongs to one simulated joint, since play and delay remember.
    """

    law: JointLaw
    gain: float
    """Factor of the command that the file lacks."""
    delay_s: float
    """Delay of the command that the file lacks, seconds."""
    added_inertia: float
    """Inertia that the file lacks, kg m^2 or kg."""
    half_gap: float
    """Half the play between the joint and its sensor, rad or m."""
    held_bias: float
    """Constant effort that the file holds, N m or N: in MJCF a part of the actuator, not of the command."""
    lacks_friction: bool
    """Whether the friction of the file is not that which was found."""
    lacks_stops: bool
    """Whether the stops of the file are not those that were found."""

    def __init__(self, law: JointLaw, held: tuple[Effect, ...] = (), run: str | None = None) -> None:
        """`held` is what the file holds. A push, which acted in one run alone, acts where `run` names that
        run."""
        found = tuple(e for e in law.effects if e.run is None or e.run == run)
        for effect in (*found, *held):
            if not any(effect.name in known for known in (EFFORTS, FRICTIONS, SCALARS, (STOP,))):
                raise ReportError(f"joint '{law.joint}': this package does not know '{effect.name}'")
        # What the file holds in place of an effect is taken back.
        lacking = [(1.0, e) for e in found if e not in held] + [(-1.0, e) for e in held if e not in found]
        self.law = law
        self._efforts = [(sign, EFFORTS[e.name], e.numbers) for sign, e in lacking if e.name in EFFORTS]
        self._others = {e.other_joint for e in found if e.other_joint is not None}
        self._stops = [(1.0 if e.end == "upper" else -1.0, e.numbers) for e in found if e.name == STOP]
        self._frictions = [(FRICTIONS[e.name], e.numbers) for e in (*law.twin, *found) if e.name in FRICTIONS]
        self.lacks_friction = any(e.name in FRICTIONS for _, e in lacking)
        self.lacks_stops = any(e.name == STOP for _, e in lacking)
        self.delay_s = _sum("delay", lacking)
        self.added_inertia = _sum("inertia", lacking)
        self.gain = _product("torque_gain", lacking)
        everything = [(1.0, e) for e in found]
        self.half_gap = _sum("backlash", everything)
        self._scale = _product("encoder_scale", everything)
        self._offset = _sum("encoder_bias", everything)
        self.held_bias = sum(e.numbers["effort"] for e in held if e.name == "constant_bias")
        self._held_offset = _sum("encoder_bias", [(1.0, e) for e in held])
        self._gauge: float | None = None
        self._commands: list[tuple[float, float]] = []

    @property
    def other_joint(self) -> str | None:
        """The other joint of a coupling."""
        return next(iter(self._others), None)

    def true_position(self, simulated: float) -> float:
        """The joint's position, where the simulator's has the sensor's offset in it."""
        return simulated - self._held_offset

    def reading(self, simulated: float) -> float:
        """What the joint's sensor shows, through its play, scale and offset; one call a sample."""
        position = self.true_position(simulated)
        self._gauge = followed(position if self._gauge is None else self._gauge, position, self.half_gap)
        return self.reading_at(self._gauge)

    def reading_at(self, gauge: float) -> float:
        """What the sensor shows where it stands at `gauge`."""
        return self._scale * gauge + self._offset

    def start_at(self, reading: float, velocity: float, play: float) -> tuple[float, float]:
        """Position and velocity of the simulated joint where its sensor shows a position and its velocity,
        and stands within its play at -1 to 1; forgets the past."""
        self._gauge = (reading - self._offset) / self._scale
        self._commands.clear()
        return self._gauge - play * self.half_gap + self._held_offset, velocity / self._scale

    def command(self, time_s: float, value: float) -> float:
        """The command to give the simulator at a time, where `value` is commanded then and until the next
        call. Times do not go back, or the past is forgotten."""
        if self._commands and time_s < self._commands[-1][0]:
            self._commands.clear()
        self._commands.append((time_s, value))
        # Half a nanosecond: times are sums of steps.
        at = bisect.bisect_right(self._commands, time_s - self.delay_s + 5e-10, key=lambda known: known[0])
        del self._commands[: max(0, at - 1)]
        return self.gain * self._commands[0][1]

    def effort(self, state: State) -> float:
        """Smooth effort that the file lacks, without stops, N m or N."""
        return sum(sign * law(numbers, state) for sign, law, numbers in self._efforts)

    def stop_effort(self, state: State) -> float:
        """Effort of the found stops, N m or N; the file must then have none."""
        return sum(stop_effort(numbers, state, side) for side, numbers in self._stops)

    def friction_bound(self, state: State) -> float:
        """Bound of all friction, the twin's and that found, N m or N."""
        return sum(max(0.0, law(numbers, state)) for law, numbers in self._frictions)

    def added_effort(self, state: State, inertia: float) -> tuple[float, float]:
        """Effort to apply beside what the file does, and bound of the friction, N m or N, in a simulator
        whose joint has the inertia `inertia`, kg m^2 or kg, and in which `state.load` acts on it."""
        total = state.load + self.effort(state)
        if self.lacks_stops:
            total += self.stop_effort(state._replace(load=total))
        # A larger inertia moves under all efforts as the simulator's does under a part of them.
        share = inertia / (inertia + self.added_inertia)
        return share * total - state.load, share * self.friction_bound(state)

    def added_effort_with_friction(self, state: State, inertia: float, step_s: float) -> float:
        """The same with friction over a step, for a simulator without friction of joints."""
        added, bound = self.added_effort(state, inertia)
        turned = state._replace(direction=-state.direction, velocity=0.0)
        share = inertia / (inertia + self.added_inertia)
        at_turn = share * self.friction_bound(turned)
        law = self.law
        return added + friction_effort(
            state, state.load + added, bound, at_turn, inertia, step_s, law.settle_time_s, law.creep_share
        )


def joints_lacking(file: StrPath, run: str | None = None) -> list[JointEffects]:
    """The joints with effects of a diagnosis. `file` is the file of its folder that the simulator loaded; the
    folder itself, where the model has the values of the twin that was diagnosed."""
    file = Path(file)
    laws = read_laws((file if file.is_dir() else file.parent) / "effects.json")
    return [JointEffects(law, () if file.is_dir() else law.held_by(file.name), run) for law in laws]


def direction(velocity: float, load: float) -> float:
    """What friction opposes: the motion, or at rest the load."""
    return math.copysign(1.0, velocity if velocity != 0.0 else load)


def _sum(name: str, effects: list[tuple[float, Effect]]) -> float:
    return sum(sign * e.numbers[SCALARS[name]] for sign, e in effects if e.name == name)


def _product(name: str, effects: list[tuple[float, Effect]]) -> float:
    return math.prod(math.pow(e.numbers[SCALARS[name]], sign) for sign, e in effects if e.name == name)
