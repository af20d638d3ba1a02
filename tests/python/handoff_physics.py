"""Rests, opens and loads a model in MuJoCo (MJCF) and PyBullet (URDF); prints JSON of what happened.

    python handoff_physics.py DIR NAME [--ball JOINT]

`rest`: largest change of any joint from each observed state in 10 s under gravity; the joint friction of the files holds it. `open`: per joint,
share of the observed interval that a constant effort takes it through. `ball`: a 5 cm ball is dropped into the link of JOINT where that joint is
open; after it settled the joint closes halfway; how far the ball is outside the link's bounds then (0: inside), meters.
"""

import argparse
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

BALL_M = 0.025
REST_S = 10.0


def single_joint(folder, name):
    """The URDF with a joint for each joint: where screws are pairs it has a folder of its own."""
    single = folder / "single_joint" / f"{name}.urdf"
    return single if single.exists() else folder / f"{name}.urdf"


def states(folder):
    report = json.loads((folder / "report.json").read_text())
    return [state["joints"] for state in report["states"]]


class MuJoCo:
    def __init__(self, folder, name, ball=None):
        import mujoco

        self.m = mujoco
        spec = mujoco.MjSpec.from_file(str(folder / f"{name}.xml"))
        if ball is not None:
            body = spec.worldbody.add_body(name="ball", pos=list(ball))
            body.add_freejoint()
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL_M, 0, 0], mass=0.05, name="ball", condim=6, friction=[0.6, 0.005, 0.001])
            for key in list(spec.keys):
                spec.delete(key)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.joints = [self.model.joint(j).name for j in range(self.model.njnt) if self.model.jnt_type[j] in (2, 3)]

    def set(self, positions):
        for name, q in positions.items():
            self.data.joint(name).qpos[0] = q
        self.m.mj_forward(self.model, self.data)

    def get(self, name):
        return float(self.data.joint(name).qpos[0])

    def run(self, seconds, efforts=None):
        for _ in range(round(seconds / self.model.opt.timestep)):
            for name, effort in (efforts or {}).items():
                self.data.joint(name).qfrc_applied[0] = effort
            self.m.mj_step(self.model, self.data)
        assert np.isfinite(self.data.qpos).all()


class PyBullet:
    def __init__(self, folder, name):
        import pybullet

        self.p = pybullet
        self.p.resetSimulation() if self.p.isConnected() else self.p.connect(self.p.DIRECT)
        self.p.setGravity(0, 0, -9.80665)
        flags = self.p.URDF_USE_INERTIA_FROM_FILE | self.p.URDF_USE_SELF_COLLISION
        # PyBullet drops `mimic`.
        path = single_joint(folder, name)
        self.body = self.p.loadURDF(str(path), useFixedBase=True, flags=flags)
        info = [self.p.getJointInfo(self.body, j) for j in range(self.p.getNumJoints(self.body))]
        self.joints = [i[1].decode() for i in info]
        robot = ElementTree.parse(path).getroot()
        # PyBullet stores joint friction and ignores it; a motor at speed 0 with that force is the same.
        for j in robot.findall("joint"):
            index, friction = self.joints.index(j.get("name")), float(j.find("dynamics").get("friction"))
            self.p.setJointMotorControl2(self.body, index, self.p.VELOCITY_CONTROL, targetVelocity=0, force=friction)

    def set(self, positions):
        for name in self.joints:
            self.p.resetJointState(self.body, self.joints.index(name), positions[name])

    def get(self, name):
        return self.p.getJointState(self.body, self.joints.index(name))[0]

    def run(self, seconds, efforts=None):
        for _ in range(round(seconds * 240)):
            for name, effort in (efforts or {}).items():
                self.p.setJointMotorControl2(self.body, self.joints.index(name), self.p.TORQUE_CONTROL, force=effort)
            self.p.stepSimulation()


def rest(simulator, observed):
    worst = {}
    for positions in observed:
        simulator.set(positions)
        simulator.run(REST_S)
        for name, q in positions.items():
            if name not in simulator.joints:  # the slide of a screw, of a file without it
                continue
            worst[name] = max(worst.get(name, 0.0), abs(simulator.get(name) - q))
    return worst


def opened(make, observed, efforts):
    shares = {}
    for name, effort in efforts.items():
        simulator, (first, last) = make(), (observed[0][name], observed[-1][name])
        simulator.set(observed[0])
        simulator.run(8.0, {name: effort * np.sign(last - first)})
        shares[name] = (simulator.get(name) - first) / (last - first)
    return shares


def efforts_of(folder, name):
    """Three times the friction and a little more: what opens a part that is not jammed."""
    robot = ElementTree.parse(single_joint(folder, name)).getroot()
    return {j.get("name"): 3 * float(j.find("dynamics").get("friction")) + 0.5 for j in robot.findall("joint")}


def ball(folder, name, joint, observed):
    bare = MuJoCo(folder, name)
    wide = max(observed, key=lambda s: abs(s[joint] - observed[0][joint]))
    if wide is observed[0]:
        wide = observed[-1]

    def bounds(simulator):
        m, d = simulator.model, simulator.data
        body = m.joint(joint).bodyid[0]
        points = []
        for g in range(m.ngeom):
            if m.geom_bodyid[g] == body and m.geom_contype[g]:
                k = m.geom_dataid[g]
                v = m.mesh_vert[m.mesh_vertadr[k] : m.mesh_vertadr[k] + m.mesh_vertnum[k]]
                points.append(v @ d.geom_xmat[g].reshape(3, 3).T + d.geom_xpos[g])
        points = np.concatenate(points)
        return points.min(axis=0), points.max(axis=0)

    bare.set(wide)
    lower, upper = bounds(bare)
    bare.set(observed[0])
    closed_lower, closed_upper = bounds(bare)
    # Above the middle of those places along the way that stand out when open and have the part's floor well below its rim.
    bare.set(wide)
    middle, way = (lower + upper) / 2, (lower + upper - closed_lower - closed_upper) / 2
    front = np.where(way > 0.01, upper, np.where(way < -0.01, lower, middle))
    hollow = []
    body = bare.model.joint(joint).bodyid[0]

    def room(place):
        hit = np.array([-1], dtype=np.int32)
        depth = bare.m.mj_ray(bare.model, bare.data, place, np.array([0.0, 0.0, -1.0]), None, 1, -1, hit)
        return depth > 3 * BALL_M and bare.model.geom_bodyid[hit[0]] == body

    for share in np.linspace(0, 1.5, 61):  # a handle lies before what stands out
        place = np.array([*(front - share * way)[:2], upper[2] + 2 * BALL_M])
        around = [(0, 0), (BALL_M, 0), (-BALL_M, 0), (0, BALL_M), (0, -BALL_M)]
        if all(room(place + [x, y, 0]) for x, y in around):
            hollow.append(place)
    if not hollow:
        return {"refused": "no floor below the rim of what stands out"}
    start = hollow[len(hollow) // 2]
    simulator = MuJoCo(folder, name, ball=start)
    simulator.set(wide)
    simulator.run(3.0)
    half = (wide[joint] + observed[0][joint]) / 2
    steps = 2000
    for k in range(steps):
        q = wide[joint] + (half - wide[joint]) * (k + 1) / steps
        now = simulator.data.joint(joint)
        now.qfrc_applied[0] = 400 * (q - now.qpos[0]) - 20 * now.qvel[0]
        simulator.m.mj_step(simulator.model, simulator.data)
    place = simulator.data.body("ball").xpos.copy()
    lower, upper = bounds(simulator)
    outside = np.maximum(np.maximum(lower - place, place - upper), 0.0)
    return {"outside_m": float(np.linalg.norm(outside)), "closed_to": simulator.get(joint), "half": half}


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("name")
    arguments.add_argument("--ball", metavar="JOINT")
    options = arguments.parse_args()
    observed, efforts = states(options.folder), efforts_of(options.folder, options.name)
    found = {}
    for key, kind in (("mujoco", MuJoCo), ("pybullet", PyBullet)):
        make = lambda: kind(options.folder, options.name)
        found[key] = {"rest": rest(make(), observed), "open": opened(make, observed, efforts)}
    if options.ball:
        found["ball"] = ball(options.folder, options.name, options.ball, observed)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
