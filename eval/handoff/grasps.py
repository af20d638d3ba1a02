"""How the opening of handles depends on what is assumed of hand, contact and joints: one hold each, no second try.

    python grasps.py RUN [RUN ...]

Uses the modules of `artitwin demo` (src/run/demonstrate), the free gripper. Every joint of every run is opened from closed by
the first hold that has room; the table gives the share that it was opened to, for each change of the assumptions.
"""
import copy
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src/run/demonstrate"))

import gripper
import mujoco
import stage
import twin


def as_it_is(model):
    pass


def less_grip(model):
    for name in gripper.Gripper.fingers:
        model.actuator(name).ctrlrange[:] = [-25, 25]


def slick(model):
    for name in gripper.Gripper.fingers:
        model.geom(name).friction[0] = 0.6


def very_slick(model):
    for name in gripper.Gripper.fingers:
        model.geom(name).friction[0] = 0.3


def loose_fingers(model):
    model.eq_active0[model.equality("demo_couple").id] = 0


def usual_solver(model):
    model.opt.cone, model.opt.impratio, model.opt.noslip_iterations = mujoco.mjtCone.mjCONE_PYRAMIDAL, 1, 0


def friction(factor):
    def change(model):
        for j in range(model.njnt):
            if not model.joint(j).name.startswith(twin.OURS):
                model.dof_frictionloss[model.jnt_dofadr[j]] *= factor

    change.__name__ = f"friction_x{factor}"
    return change


def ghost(model):
    """Nothing is held: what still opens is not opened by contact."""
    for g in range(model.ngeom):
        if model.geom(g).name.startswith(twin.OURS):
            model.geom_contype[g] = model.geom_conaffinity[g] = 0


CHANGES = [as_it_is, ghost, less_grip, slick, very_slick, loose_fingers, usual_solver, friction(5), friction(25)]


def opened(folder):
    """Per joint, the share for each change."""
    spec, bare = twin.load(twin.mjcf_of(folder))
    joints = twin.joints_of(bare)
    robot = gripper.Gripper()
    model = stage.build(spec, robot, 0.02, [1, 0, 0])
    for joint in joints:
        hold = next(stage.Stage(model, joints, robot).holds(joint, joint.open), None)
        yield joint.name, [hold and tried(model, joints, robot, joint, hold, change) for change in CHANGES]


def tried(model, joints, robot, joint, hold, change):
    changed = copy.copy(model)
    change(changed)
    world = stage.Stage(changed, joints, robot)
    world.scene = stage.Scene(changed, world.data, joint, robot.geoms)
    return world.perform(joint, hold, joint.open)["share_held"]


def main():
    print(f"{'run':16} {'joint':10} " + " ".join(f"{c.__name__:>13}" for c in CHANGES))
    for run in map(Path, sys.argv[1:]):
        for name, shares in opened(run):
            print(f"{run.name:16} {name:10} " + " ".join(f"{'-' if s is None else format(s, '.1%'):>13}" for s in shares), flush=True)


if __name__ == "__main__":
    main()
