"""The effects in MuJoCo."""

import importlib
from types import TracebackType
from typing import Any

from ..process import StrPath
from .joint import JointEffects, direction, joints_lacking
from .laws import State

mujoco: Any = importlib.import_module("mujoco")

_HARD = 0.9995
"""Solver impedance of friction without a settle time, as in `twin.xml`."""
_NO_FRICTION = 1e-9
"""Least bound of friction, N m or N: a joint without any would get no constraint."""
_OF_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_FRICTION_OF_DOF = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)


class _Placed:
    """A joint in a model."""

    def __init__(self, model: Any, effects: JointEffects) -> None:
        joint = model.joint(effects.law.joint)
        self.effects = effects
        self.id = int(joint.id)
        self.position = int(joint.qposadr[0])
        self.velocity = int(joint.dofadr[0])
        other = effects.other_joint
        self.other = None if other is None else int(model.joint(other).qposadr[0])


class MujocoEffects:
    """The effects that a model lacks, while a `with` block lasts.

    They act in MuJoCo's callback `mjcb_passive`, so also under a viewer. Friction and inertia become those of
    the model: `dof_frictionloss` follows the state. A model is used by one thread.
    """

    def __init__(self, model: Any, file: StrPath, run: str | None = None) -> None:
        """`model` is the `MjModel` of `file`: a file of a diagnosis, or its folder if the model is another
        one with the values of the twin that was diagnosed. Joints go by their names. A push, which acted in
        one run alone, acts where `run` names that run."""
        self._model = model
        self._joints = {e.law.joint: _Placed(model, e) for e in joints_lacking(file, run)}
        effects = [placed.effects for placed in self._joints.values()]
        self._needs_drive = any(e.lacks_friction or e.lacks_stops for e in effects)
        self._previous: Any = None
        for placed in self._joints.values():
            self._change_model(placed)
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def __enter__(self) -> "MujocoEffects":
        self._previous = mujoco.get_mjcb_passive()
        mujoco.set_mjcb_passive(self._act)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        mujoco.set_mjcb_passive(self._previous)

    def command(self, joint: str, time_s: float, value: float) -> float:
        """What to write to `ctrl` or `qfrc_applied` at a time where `value` is commanded: late and scaled,
        as far as the model's actuators are not. One call a step, in the order of time."""
        placed = self._joints.get(joint)
        return value if placed is None else placed.effects.command(time_s, value)

    def reading(self, joint: str, data: Any) -> float:
        """Position that the joint's sensor shows, rad or m; one call a sample."""
        placed = self._joints.get(joint)
        if placed is None:
            return float(data.joint(joint).qpos[0])
        return placed.effects.reading(float(data.qpos[placed.position]))

    def start_at(
        self, joint: str, data: Any, reading: float, velocity: float = 0.0, play: float = 0.0
    ) -> None:
        """Puts a joint where its sensor shows `reading`, moves at `velocity` and stands within its play at
        -1 to 1; without a past."""
        placed = self._joints.get(joint)
        if placed is not None:
            reading, velocity = placed.effects.start_at(reading, velocity, play)
        data.joint(joint).qpos, data.joint(joint).qvel = reading, velocity

    def _change_model(self, placed: _Placed) -> None:
        """What of the effects the model can be."""
        model, effects = self._model, placed.effects
        model.dof_armature[placed.velocity] += effects.added_inertia
        if effects.lacks_stops:
            model.jnt_limited[placed.id] = False
        if effects.delay_s < 0.0:
            # The file has a delay in place of what was found.
            is_own = (model.actuator_trntype == _OF_JOINT) & (model.actuator_trnid[:, 0] == placed.id)
            late = is_own & (model.actuator_delay > 0.0)
            rest_s = model.actuator_delay[late] + effects.delay_s
            # The file's delays are half a step longer than what it holds.
            model.actuator_delay[late] = rest_s * (rest_s >= model.opt.timestep)
        if effects.lacks_friction:
            settle_s = effects.law.settle_time_s
            impedance = 1.0 - effects.law.creep_share if settle_s > 0.0 else _HARD
            # MuJoCo keeps time constants of constraints above two time steps.
            model.dof_solref[placed.velocity] = max(2.0 * settle_s, 2.0 * model.opt.timestep), 1.0
            model.dof_solimp[placed.velocity, :3] = impedance, impedance, 0.001
            model.dof_frictionloss[placed.velocity] = _NO_FRICTION

    def _act(self, model: Any, data: Any) -> None:
        if self._previous is not None:
            self._previous(model, data)
        if model is not self._model:
            return
        if self._needs_drive:
            # MuJoCo computes the actuators' efforts after the passive ones.
            mujoco.mj_fwdActuation(model, data)
        for placed in self._joints.values():
            dof, effects = placed.velocity, placed.effects
            velocity = float(data.qvel[dof])
            driven = float(data.qfrc_actuator[dof] + data.qfrc_applied[dof])
            state = State(
                position=effects.true_position(float(data.qpos[placed.position])),
                velocity=velocity,
                drive=driven - effects.held_bias,
                other=0.0 if placed.other is None else float(data.qpos[placed.other]),
                time_s=float(data.time),
            )
            added = effects.effort(state)
            load = driven + float(data.qfrc_passive[dof] - data.qfrc_bias[dof]) + added
            state = state._replace(load=load, direction=direction(velocity, load))
            if effects.lacks_stops:
                added += effects.stop_effort(state)
            data.qfrc_passive[dof] += added
            if effects.lacks_friction:
                self._set_friction(data, dof, max(effects.friction_bound(state), _NO_FRICTION))

    def _set_friction(self, data: Any, dof: int, bound: float) -> None:
        """Sets the bound of a friction, for the next step and in the constraints that this one has made."""
        self._model.dof_frictionloss[dof] = bound
        for row in range(data.ne, data.ne + data.nf):
            if data.efc_id[row] == dof and data.efc_type[row] == _FRICTION_OF_DOF:
                data.efc_frictionloss[row] = bound
                # The solver reads the same by islands, where there are some.
                if data.nisland:
                    data.iefc_frictionloss[data.map_efc2iefc[row]] = bound
