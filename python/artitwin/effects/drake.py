"""The effects in Drake."""

import importlib
from typing import Any

import numpy as np

from ..process import StrPath
from ..record import Array
from .joint import JointEffects, direction, joints_lacking
from .laws import State, followed

_framework: Any = importlib.import_module("pydrake.systems.framework")
_tree: Any = importlib.import_module("pydrake.multibody.tree")


class _Placed:
    """A joint in a plant, and its numbers in the system's discrete state: gauge, then late commands."""

    def __init__(self, plant: Any, effects: JointEffects, first: int, step_s: float) -> None:
        joint = plant.GetJointByName(effects.law.joint)
        self.effects = effects
        self.position = int(joint.position_start())
        self.velocity = int(joint.velocity_start())
        other = effects.other_joint
        self.other = None if other is None else int(plant.GetJointByName(other).position_start())
        self.gauge = first
        self.late = range(first + 1, first + 1 + max(0, round(effects.delay_s / step_s)))


class DrakeEffects(_framework.LeafSystem):  # type: ignore[misc]
    """The effects that a plant lacks, in discrete time with the plant's step.

    Inputs: `state` of the plant and `command`, an effort for each of its velocities. Outputs:
    `generalized_force`, for the plant's applied generalized force, which holds the commands and the effects,
    friction among them (Drake's joints have none); `reading`, the plant's positions as the sensors show
    them. A servo or an actuator of the plant acts beside them.
    """

    def __init__(self, plant: Any, file: StrPath, run: str | None = None) -> None:
        """`plant` is a finalized `MultibodyPlant` in discrete time of `file`: a file of a diagnosis, or its
        folder if the plant has the values of the twin that was diagnosed."""
        super().__init__()
        self._plant, self._context = plant, plant.CreateDefaultContext()
        self._step_s = float(plant.time_step())
        self._joints: list[_Placed] = []
        size = 0
        for effects in joints_lacking(file, run):
            self._joints.append(_Placed(plant, effects, size, self._step_s))
            size = self._joints[-1].late.stop
        # Before the first step a gauge stands where the joint is, and what was commanded is commanded.
        self.DeclareDiscreteState(np.full(size, np.nan))
        count = plant.num_velocities()
        self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self.DeclareVectorInputPort("command", count)
        self.DeclareVectorOutputPort("generalized_force", count, self._write_force)
        self.DeclareVectorOutputPort("reading", plant.num_positions(), self._write_reading)
        self.DeclarePeriodicDiscreteUpdateEvent(self._step_s, 0.0, self._update)

    def _write_force(self, context: Any, output: Any) -> None:
        plant, own = self._plant, self._context
        state = self.GetInputPort("state").Eval(context)
        late = context.get_discrete_state_vector().value()
        plant.SetPositionsAndVelocities(own, state)
        positions, velocities = plant.GetPositions(own), plant.GetVelocities(own)
        force: Array = self.GetInputPort("command").Eval(context).copy()
        for placed in self._joints:
            if placed.late and not np.isnan(late[placed.late.start]):
                force[placed.velocity] = late[placed.late.start]
            force[placed.velocity] *= placed.effects.gain
        # What the plant does by itself: gravity, damping and springs, less Coriolis efforts.
        elements = _tree.MultibodyForces(plant)
        plant.CalcForceElementsContribution(own, elements)
        inverse = np.linalg.inv(plant.CalcMassMatrix(own))
        loads = force + plant.CalcGeneralizedForces(own, elements) - plant.CalcBiasTerm(own)
        accelerations = inverse @ loads
        for placed in self._joints:
            # The inertia that the joint moves while the others are free, and the load that goes with it.
            inertia = 1.0 / inverse[placed.velocity, placed.velocity]
            load = inertia * accelerations[placed.velocity]
            moving = State(
                position=placed.effects.true_position(positions[placed.position]),
                velocity=velocities[placed.velocity],
                drive=force[placed.velocity],
                load=load,
                other=0.0 if placed.other is None else positions[placed.other],
                time_s=context.get_time(),
            )
            heading = direction(moving.velocity, load + placed.effects.effort(moving))
            force[placed.velocity] += placed.effects.added_effort_with_friction(
                moving._replace(direction=heading), inertia, self._step_s
            )
        output.SetFromVector(force)

    def _gauges(self, context: Any) -> list[float]:
        state = self.GetInputPort("state").Eval(context)
        known = context.get_discrete_state_vector().value()
        gauges = []
        for placed in self._joints:
            position = placed.effects.true_position(state[placed.position])
            gauge = position if np.isnan(known[placed.gauge]) else known[placed.gauge]
            gauges.append(followed(gauge, position, placed.effects.half_gap))
        return gauges

    def _write_reading(self, context: Any, output: Any) -> None:
        shown = self.GetInputPort("state").Eval(context)[: self._plant.num_positions()].copy()
        for placed, gauge in zip(self._joints, self._gauges(context), strict=True):
            shown[placed.position] = placed.effects.reading_at(gauge)
        output.SetFromVector(shown)

    def _update(self, context: Any, discrete: Any) -> None:
        values = context.get_discrete_state_vector().value().copy()
        command = self.GetInputPort("command").Eval(context)
        for placed, gauge in zip(self._joints, self._gauges(context), strict=True):
            values[placed.gauge] = gauge
            if placed.late:
                late = values[placed.late.start : placed.late.stop]
                late[np.isnan(late)] = command[placed.velocity]
                late[:] = [*late[1:], command[placed.velocity]]
        discrete.set_value(values)
