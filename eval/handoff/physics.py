"""Whether the joints of finished runs hold still and move freely with self collision.

    python physics.py RUN [RUN ...]

For MuJoCo (the MJCF, with the pairs that it excludes taken in again) and PyBullet (the URDF, with
URDF_USE_SELF_COLLISION_INCLUDE_PARENT): the largest change of a joint's position in 5 s in the observed
states, and how far from its limits the worst joint stays when a controller drives it from one to the other,
as a share of its range. Positions in rad or m. Bullet drives at 1 rad/s or 0.03 m/s for twice the time that this
takes: at 0.1 m/s and more (0.4 mm a step of 1/240 s) contact points of earlier steps, which it keeps up to 20 mm,
stop some parts that nothing is nearer to than 3 mm.

Needs numpy, mujoco, pybullet.
"""
import json
import sys
from pathlib import Path

import mujoco
import numpy as np
import pybullet as bullet


def follow(model, data):
    for e in range(model.neq):
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT:
            leader = model.jnt_qposadr[model.eq_obj2id[e]]
            data.qpos[model.jnt_qposadr[model.eq_obj1id[e]]] = model.eq_data[e][1] * data.qpos[leader]


def in_mujoco(run, report):
    spec = mujoco.MjSpec.from_file(str(run / f"{report['name']}.xml"))
    for key in list(spec.keys) + list(spec.excludes):
        spec.delete(key)
    model = spec.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    data = mujoco.MjData(model)
    drift = 0.0
    for state in report["states"]:
        mujoco.mj_resetData(model, data)
        for name, q in state["joints"].items():
            data.joint(name).qpos[0] = q
        follow(model, data)
        start = data.qpos.copy()
        for _ in range(int(5 / model.opt.timestep)):
            mujoco.mj_step(model, data)
        drift = max(drift, float(np.abs(data.qpos - start).max(initial=0)))
    worst = 0.0
    for joint in report["joints"]:
        lower, upper = joint["limit"]["lower"], joint["limit"]["upper"]
        dof = model.joint(joint["name"]).dofadr[0]
        mujoco.mj_resetData(model, data)
        for target in (upper, lower, upper):
            # Inertia sets the gains, as fixed ones shake a light part; the joint's own friction and its load come on top.
            inertia, friction = model.dof_M0[dof], model.dof_frictionloss[dof]
            start, steps = float(data.joint(joint["name"]).qpos[0]), int(3 / model.opt.timestep)
            for step in range(steps):
                goal = start + (target - start) * min(1.0, 1.3 * step / steps)
                error = goal - float(data.joint(joint["name"]).qpos[0])
                push = inertia * (900 * error - 60 * float(data.joint(joint["name"]).qvel[0]))
                push += 2 * friction * np.clip(error / 0.002, -1, 1)
                most = 4 * friction + 40 * inertia
                data.qfrc_applied[dof] = data.qfrc_bias[dof] + np.clip(push, -most, most)
                mujoco.mj_step(model, data)
            worst = max(worst, abs(float(data.joint(joint["name"]).qpos[0]) - target) / (upper - lower))
        data.qfrc_applied[dof] = 0
    return drift, worst


def in_bullet(run, report):
    bullet.resetSimulation()
    bullet.setGravity(0, 0, -9.81)
    # Bullet drops `mimic`: where screws are pairs, the file with a joint for each joint.
    single = run / "single_joint" / f"{report['name']}.urdf"
    urdf = single if single.exists() else run / f"{report['name']}.urdf"
    flags = (bullet.URDF_USE_INERTIA_FROM_FILE | bullet.URDF_USE_SELF_COLLISION
             | bullet.URDF_USE_SELF_COLLISION_INCLUDE_PARENT)
    body = bullet.loadURDF(str(urdf), useFixedBase=True, flags=flags)
    info = {i[1].decode(): i for i in (bullet.getJointInfo(body, j) for j in range(bullet.getNumJoints(body)))}
    drift = 0.0
    for state in report["states"]:
        for name, i in info.items():
            bullet.resetJointState(body, i[0], state["joints"].get(name, 0))
            bullet.setJointMotorControl2(body, i[0], bullet.VELOCITY_CONTROL, targetVelocity=0, force=i[7])
        for _ in range(1200):
            bullet.stepSimulation()
        for name, q in ((n, q) for n, q in state["joints"].items() if n in info):
            drift = max(drift, abs(bullet.getJointState(body, info[name][0])[0] - q))
    worst = 0.0
    for joint in report["joints"]:
        i = info[joint["name"]]
        lower, upper = joint["limit"]["lower"], joint["limit"]["upper"]
        for k in info.values():
            bullet.resetJointState(body, k[0], 0)
        speed = 0.03 if joint["type"] == "prismatic" else 1.0
        for target in (upper, lower, upper):
            for _ in range(int(240 * 2 * (1 + (upper - lower) / speed))):
                bullet.setJointMotorControl2(body, i[0], bullet.POSITION_CONTROL, targetPosition=target,
                                             force=max(1.0, 4 * i[7]), maxVelocity=speed)
                bullet.stepSimulation()
            worst = max(worst, abs(bullet.getJointState(body, i[0])[0] - target) / (upper - lower))
        bullet.setJointMotorControl2(body, i[0], bullet.VELOCITY_CONTROL, targetVelocity=0, force=i[7])
    return drift, worst


def main():
    bullet.connect(bullet.DIRECT)
    print(f"{'run':16} {'MuJoCo drift':>13} {'short of':>9} {'Bullet drift':>13} {'short of':>9}")
    for run in map(Path, sys.argv[1:]):
        report = json.loads((run / "report.json").read_text())
        (a, b), (c, d) = in_mujoco(run, report), in_bullet(run, report)
        print(f"{run.name:16} {a:13.4f} {b:9.1%} {c:13.4f} {d:9.1%}", flush=True)


if __name__ == "__main__":
    main()
