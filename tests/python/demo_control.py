"""Opens the first joint of a run with the hand of `artitwin demo`, once as it is and once with a hand that touches nothing.

    python demo_control.py MODULES RUN

MODULES is src/run/demonstrate. Prints JSON: the shares that the joint was opened to, `touching` and `ghost`, and `driven`: the largest
force that anything but contact, gravity and the joints themselves put on the twin, N or N m.
"""

import json
import sys

sys.path.insert(0, sys.argv[1])

import gripper
import numpy as np
import stage
import twin


def opened(ghost):
    spec, bare, states = twin.load(twin.mjcf_of(sys.argv[2]))
    joints, robot = twin.joints_of(bare, states), gripper.Gripper()
    model = stage.build(spec, robot, 0.02, [1, 0, 0])
    world, joint = stage.Stage(model, joints, robot), joints[0]
    hold = next(world.holds(joint, joint.open))
    if ghost:
        for g in robot.geoms:
            model.geom_contype[g] = model.geom_conaffinity[g] = 0
    step, driven = world.step, [0.0]
    theirs = [model.joint(j.name).dofadr[0] for j in joints]
    bodies = [b for b in range(model.nbody) if not model.body(b).name.startswith(twin.OURS)]

    def watched():
        step()
        d = world.data
        for forces in (d.qfrc_applied[theirs], d.qfrc_actuator[theirs], d.xfrc_applied[bodies]):
            driven[0] = max(driven[0], float(np.abs(forces).max()))

    world.step = watched
    return world.perform(joint, hold, joint.open)["share"], driven[0], int((model.eq_type == 1).sum())


touching, driven, welds = opened(False)
ghost, _, _ = opened(True)
print(json.dumps({"touching": touching, "ghost": ghost, "driven": driven, "welds": welds}))
