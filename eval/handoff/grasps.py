"""How the opening of handles depends on what is assumed of hand, contact and joints: one hold each, no second try.

    python grasps.py [--handles] RUN [RUN ...]

Uses the modules of `artitwin demo` (src/run/demonstrate), the free gripper. Every joint of every run is opened from closed by
the first hold that has room; the table gives the share that it was opened to, for each change of the assumptions. `--handles`: only by the handles of the eight
objects, whose places are listed here, with six tries; how square the faces that are held stand to the fingers, degrees off.
"""
import copy
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src/run/demonstrate"))

import gripper
import mujoco
import numpy as np
import stage
import twin
from hold import squareness


# Run, joint: middle of the handle where the joint is closed, m, and how far from it a hold counts.
HANDLES = {
    ("drawer", "joint_1"): ((0.31, 0.0, 0.37), 0.08),
    ("fridge", "joint_1"): ((0.51, 0.17, 1.05), 0.16),
    ("fridge", "joint_2"): ((0.41, 0.21, 0.6), 0.14),
    ("calvin_table", "joint_1"): ((0.0, 0.03, 0.71), 0.06),
    ("calvin_table", "joint_2"): ((0.12, -0.33, 0.45), 0.16),
    ("sektion_cabinet", "joint_1"): ((0.385, 0.03, 0.06), 0.03),
    ("sektion_cabinet", "joint_2"): ((0.4, 0.04, 0.33), 0.08),
    ("sektion_cabinet", "joint_3"): ((0.4, -0.03, 0.06), 0.03),
    ("sektion_cabinet", "joint_4"): ((0.37, 0.03, 0.2), 0.08),
    ("jar_screw", "joint_1"): ((0.065, 0.0, 0.15), 0.03),
}
# A hold on a handle is at most so far behind what stands out most, m.
FRONT = 0.02


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
    spec, bare, states = twin.load(twin.mjcf_of(folder))
    joints = twin.joints_of(bare, states)
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


def by_handle(folder):
    """Per handle: share that it was opened to, the hold's angle off, tries."""
    spec, bare, states = twin.load(twin.mjcf_of(folder))
    joints = twin.joints_of(bare, states)
    robot = gripper.Gripper()
    model = stage.build(spec, robot, 0.02, [1, 0, 0])
    for joint in joints:
        if (folder.name, joint.name) not in HANDLES:
            continue
        middle, near = HANDLES[folder.name, joint.name]
        world, best = stage.Stage(model, joints, robot), (-1.0, 90.0, 0)
        begin, tries = world.kept(), 0
        for hold in world.holds(joint, joint.open):
            # A door that slides has its handle on a face beside its way.
            stands_out = joint.kind != "hinge" or world.scene.ahead(hold.front) < FRONT
            if hold.kind != "grasp" or not stands_out or np.linalg.norm(hold.front - middle) > near:
                continue
            tries += 1
            off = float(np.degrees(np.arccos(min(1.0, squareness(world.scene, hold)))))
            world.back(begin)
            best = max(best, (world.perform(joint, hold, joint.open)["share"], off, tries))
            world.back(begin)
            if best[0] > 0.9 or tries == 6:
                break
        yield joint.name, best


def main():
    runs = [Path(r) for r in sys.argv[1:] if r != "--handles"]
    if "--handles" in sys.argv:
        print(f"{'run':16} {'joint':10} {'opened':>7} {'off':>5} try")
        for run in runs:
            for name, (share, off, tries) in by_handle(run):
                print(f"{run.name:16} {name:10} {share:7.1%} {off:5.1f} {tries}", flush=True)
        return
    print(f"{'run':16} {'joint':10} " + " ".join(f"{c.__name__:>13}" for c in CHANGES))
    for run in runs:
        for name, shares in opened(run):
            print(f"{run.name:16} {name:10} " + " ".join(f"{'-' if s is None else format(s, '.1%'):>13}" for s in shares), flush=True)


if __name__ == "__main__":
    main()
