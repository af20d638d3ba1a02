"""The effects in PyBullet."""

import importlib
import math
from collections.abc import Mapping
from typing import Any

from ..process import StrPath
from .file import JointLaw
from .joint import JointEffects, direction, joints_lacking
from .laws import State

_pybullet: Any = importlib.import_module("pybullet")


class PybulletEffects:
    """The effects that a body lacks.

    Friction becomes that of the joint's motor, which brings the joint to rest with the bound of the
    friction as its largest force. The library's own damping of links (`linearDamping`, `angularDamping`) is
    no friction of a twin: `changeDynamics` sets it to 0.
    """

    def __init__(self, body: int, file: StrPath, run: str | None = None, client: Any = _pybullet) -> None:
        """`body` is that of `file`: a URDF of a diagnosis, or its folder if the body is another one with the
        values of the twin that was diagnosed. `client` is the module or a `BulletClient`."""
        self._body, self._client = body, client
        infos = [client.getJointInfo(body, index) for index in range(client.getNumJoints(body))]
        # Fixed joints (type 4) have no place among the positions.
        self._moving = [info[0] for info in infos if info[2] != client.JOINT_FIXED]
        self._names = {info[0]: info[1].decode() for info in infos}
        self._index = {name: index for index, name in self._names.items()}
        self._damping = {info[0]: info[6] for info in infos}
        self._joints = {e.law.joint: e for e in joints_lacking(file, run)}
        self._step_s = float(client.getPhysicsEngineParameters()["fixedTimeStep"])
        self._time_s = 0.0

    def apply(self, commands: Mapping[str, float]) -> None:
        """Applies the efforts that are commanded at joints, N m or N, with the effects. Once before each
        `stepSimulation`."""
        states = self._client.getJointStates(self._body, self._moving)
        positions = [state[0] for state in states]
        velocities = [state[1] for state in states]
        mass = self._client.calculateMassMatrix(self._body, positions)
        rest = [0.0] * len(positions)
        needed = self._client.calculateInverseDynamics(self._body, positions, velocities, rest)
        for place, index in enumerate(self._moving):
            velocity = velocities[place]
            own = -needed[place] - self._damping[index] * velocity
            name = self._names[index]
            effects = self._joints.get(name)
            if effects is None:
                if name in commands:
                    self._drive(index, commands[name])
                continue
            drive = effects.command(self._time_s, commands.get(name, 0.0))
            other = effects.other_joint
            state = State(
                position=effects.true_position(positions[place]),
                velocity=velocity,
                drive=drive,
                load=drive + own,
                other=0.0 if other is None else positions[self._moving.index(self._index[other])],
                time_s=self._time_s,
            )
            state = state._replace(direction=direction(velocity, state.load + effects.effort(state)))
            inertia = mass[place][place]
            added, bound = effects.added_effort(state, inertia)
            self._hold(index, effects.law, bound, (state.load + added) / inertia)
            self._drive(index, drive + added)
        self._time_s += self._step_s

    def reading(self, joint: str) -> float:
        """Position that the joint's sensor shows, rad or m; one call a sample."""
        position = float(self._client.getJointState(self._body, self._index[joint])[0])
        effects = self._joints.get(joint)
        return position if effects is None else effects.reading(position)

    def remember(self, joint: str, time_s: float, command: float) -> None:
        """An effort that was commanded before the first step, at a time below 0: a delay reaches back."""
        effects = self._joints.get(joint)
        if effects is not None:
            effects.command(time_s, command)

    def start_at(self, joint: str, reading: float, velocity: float = 0.0, play: float = 0.0) -> None:
        """Puts a joint where its sensor shows `reading`, moves at `velocity` and stands within its play at
        -1 to 1; without a past."""
        effects = self._joints.get(joint)
        if effects is not None:
            reading, velocity = effects.start_at(reading, velocity, play)
        self._client.resetJointState(self._body, self._index[joint], reading, velocity)

    def _hold(self, index: int, law: JointLaw, bound: float, acceleration: float) -> None:
        """Gives a joint its friction as a motor; `acceleration` is that of all other efforts."""
        settle_s = law.settle_time_s
        keep = math.exp(-self._step_s / settle_s) if settle_s > 0.0 else 0.0
        # The motor keeps this share of what the other efforts add in the step, too: it aims lower.
        target = (law.creep_share * settle_s - self._step_s * keep / (1.0 - keep)) * acceleration
        self._client.setJointMotorControl2(
            self._body,
            index,
            self._client.VELOCITY_CONTROL,
            targetVelocity=target,
            velocityGain=1.0 - keep,
            force=bound,
        )

    def _drive(self, index: int, effort: float) -> None:
        self._client.setJointMotorControl2(self._body, index, self._client.TORQUE_CONTROL, force=effort)
