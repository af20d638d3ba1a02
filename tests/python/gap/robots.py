"""Published robots (the URDFs of pybullet_data) with friction hidden in one joint, logged as drives measure: efforts are
sampled with the positions. All joints are logged; one or two of them move, the others hold their places.

The motion is a sum of sines. The efforts are those of the URDF (recursive Newton-Euler, in numpy), of its damping and
friction, and of the friction that the twin lacks.

usage: robots.py PROGRAM WORK [NAME ...]    prints a JSON object: by name, what was hidden and what was found
"""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pybullet_data
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_JAZZY)
STATE = "sensor_msgs/msg/JointState"
RUNS = 3
SECONDS = 12.0
# Of the positions (rad or m), and of the efforts as a share of their size.
POSITION_NOISE = 1e-4
EFFORT_NOISE = 0.005
# Velocity within which friction changes its sign, rad/s or m/s.
SMOOTH = 1e-3
# Hidden friction as a share of the joint's effort.
HIDDEN = 0.25

# By name: URDF, joint with hidden friction, joints that move beside it, samples a second.
ROBOTS = {
    "panda_elbow": ("franka_panda/panda.urdf", "panda_joint4", ["panda_joint2"], 200),
    "panda_wrist": ("franka_panda/panda.urdf", "panda_joint6", [], 100),
    "iiwa_elbow": ("kuka_iiwa/model.urdf", "lbr_iiwa_joint_4", ["lbr_iiwa_joint_2"], 200),
    "iiwa_shoulder": ("kuka_iiwa/model_vr_limits.urdf", "lbr_iiwa_joint_2", ["lbr_iiwa_joint_6"], 100),
    "xarm": ("xarm/xarm6_robot.urdf", "joint3", ["joint2"], 100),
    "xarm_gripper": ("xarm/xarm6_with_gripper.urdf", "joint2", ["joint5"], 250),
    "a1": ("a1/a1.urdf", "FR_upper_joint", ["FR_lower_joint"], 200),
    "aliengo": ("aliengo/aliengo.urdf", "RL_lower_joint", [], 100),
    "laikago": ("laikago/laikago.urdf", "FR_upper_leg_2_hip_motor_joint", [], 100),
    "laikago_toes": ("laikago/laikago_toes_limits.urdf", "FL_lower_leg_2_upper_leg_joint", ["FL_upper_leg_2_hip_motor_joint"], 200),
    "mini_cheetah": ("mini_cheetah/mini_cheetah.urdf", "abduct_fr_to_thigh_fr_j", ["torso_to_abduct_fr_j"], 100),
    "spirit": ("quadruped/spirit40.urdf", "0", ["1"], 100),
    "vision": ("quadruped/vision60.urdf", "8", [], 50),
    "pendulum": ("pendulum5.urdf", "joint2", ["joint3"], 100),
    "cartpole": ("cartpole.urdf", "cart_to_pole", [], 200),
    "two_joints": ("TwoJointRobot_wo_fixedJoints.urdf", "joint_1", [], 100),
    "husky": ("husky/husky.urdf", "front_left_wheel", [], 100),
    "racecar": ("racecar/racecar.urdf", "left_steering_hinge_joint", [], 100),
    "r2d2": ("r2d2.urdf", "head_swivel", [], 100),
    "pr2_gripper": ("pr2_gripper.urdf", "left_gripper_joint", [], 100),
    "biped": ("biped/biped2d_pybullet.urdf", "torso_to_rightleg", ["r_knee"], 100),
    "minitaur": ("quadruped/minitaur_single_motor.urdf", None, [], 100),
}


def numbers(element, name, default):
    text = None if element is None else element.get(name)
    return np.array(default if text is None else [float(x) for x in text.split()])


def rotation(rpy):
    (sr, cr), (sp, cp), (sy, cy) = [(np.sin(a), np.cos(a)) for a in rpy]
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])


def turns(axis, q):
    """Rotations about an axis by angles: (T, 3, 3)."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s = np.sin(q)[:, None, None]
    c = np.cos(q)[:, None, None]
    return np.eye(3) + s * k + (1 - c) * (k @ k)


class Robot:
    """Links and joints of a URDF, parents first."""

    def __init__(self, path):
        root = ET.parse(path).getroot()
        self.links = {}
        for link in root.findall("link"):
            inertial = link.find("inertial")
            mass = center = 0.0
            tensor = np.zeros((3, 3))
            if inertial is not None:
                origin = inertial.find("origin")
                turn = rotation(numbers(origin, "rpy", [0, 0, 0]))
                center = numbers(origin, "xyz", [0, 0, 0])
                mass = float(inertial.find("mass").get("value"))
                i = {k: float(v) for k, v in inertial.find("inertia").attrib.items()}
                own = np.array([
                    [i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]],
                ])
                tensor = turn @ own @ turn.T
            self.links[link.get("name")] = (mass, center * np.ones(3), tensor)
        left = root.findall("joint")
        children = {j.find("child").get("link") for j in left}
        reached = {name for name in self.links if name not in children}
        self.joints = []
        while left:
            ready = [j for j in left if j.find("parent").get("link") in reached]
            assert ready, "no tree"
            for j in ready:
                self.joints.append(j)
                reached.add(j.find("child").get("link"))
                left.remove(j)
        self.moving = [j for j in self.joints if j.get("type") in ("revolute", "continuous", "prismatic")]
        self.names = [j.get("name") for j in self.moving]
        self.mimics = {j.get("name"): j.find("mimic") for j in self.moving if j.find("mimic") is not None}

    def joint(self, name):
        return self.moving[self.names.index(name)]

    def own_friction(self, name):
        dynamics = self.joint(name).find("dynamics")
        return [float(numbers(dynamics, key, [0.0])[0]) for key in ("damping", "friction")]

    def efforts(self, q, v, a):
        """Efforts of the links alone, by joint: arrays of one length, by joint, in and out."""
        count = len(next(iter(q.values())))
        zeros = np.zeros((count, 3))
        up = np.tile([0.0, 0.0, 9.81], (count, 1))
        identity = np.tile(np.eye(3), (count, 1, 1))
        motion = {name: (identity, zeros, zeros, zeros, up) for name in self.links}
        frames = {}
        for j in self.joints:
            r, p, w, dw, acc = motion[j.find("parent").get("link")]
            origin = j.find("origin")
            arm = r @ numbers(origin, "xyz", [0, 0, 0])
            turned = r @ rotation(numbers(origin, "rpy", [0, 0, 0]))
            axis = numbers(j.find("axis"), "xyz", [1, 0, 0])
            axis = axis / (np.linalg.norm(axis) or 1.0)
            name = j.get("name")
            line = turned @ axis
            if name in q and j.get("type") == "prismatic":
                arm = arm + line * q[name][:, None]
            own_acc = acc + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
            own_w, own_dw = w, dw
            if name in q and j.get("type") == "prismatic":
                own_acc = own_acc + line * a[name][:, None] + 2 * np.cross(w, line * v[name][:, None])
            elif name in q:
                turned = turned @ turns(axis, q[name])
                own_w = w + line * v[name][:, None]
                own_dw = dw + line * a[name][:, None] + np.cross(w, line * v[name][:, None])
            motion[j.find("child").get("link")] = (turned, p + arm, own_w, own_dw, own_acc)
            frames[name] = (line, p + arm)
        wrench = {}
        for name, (mass, center, tensor) in self.links.items():
            r, p, w, dw, acc = motion[name]
            arm = r @ center
            force = mass * (acc + np.cross(dw, arm) + np.cross(w, np.cross(w, arm)))
            inertia = r @ tensor @ np.swapaxes(r, 1, 2)
            spin = np.einsum("tij,tj->ti", inertia, dw) + np.cross(w, np.einsum("tij,tj->ti", inertia, w))
            wrench[name] = [force, spin + np.cross(p + arm, force)]
        found = {}
        for j in reversed(self.joints):
            force, moment = wrench[j.find("child").get("link")]
            line, place = frames[j.get("name")]
            if j.get("type") == "prismatic":
                found[j.get("name")] = np.sum(line * force, axis=1)
            else:
                found[j.get("name")] = np.sum(line * (moment - np.cross(place, force)), axis=1)
            parent = wrench[j.find("parent").get("link")]
            parent[0] = parent[0] + force
            parent[1] = parent[1] + moment
        return found


def range_of(joint):
    """Where a joint moves: the middle, and the largest way from it."""
    limit = joint.find("limit")
    low, high = [float(numbers(limit, key, [0.0])[0]) for key in ("lower", "upper")]
    widest = 0.25 if joint.get("type") == "prismatic" else 1.0
    if joint.get("type") == "continuous" or not high > low:
        return 0.2, widest
    return 0.5 * (low + high), min(0.45 * (high - low), widest)


def sines(rng, t, middle, way):
    q = np.full_like(t, middle)
    v = np.zeros_like(t)
    a = np.zeros_like(t)
    for hertz, share in ((0.17, 0.6), (0.43, 0.25), (1.1, 0.1), (2.3, 0.03)):
        w = 2 * np.pi * hertz * rng.uniform(0.9, 1.1)
        phase = rng.uniform(0, 2 * np.pi)
        q += way * share * np.sin(w * t + phase)
        v += way * share * w * np.cos(w * t + phase)
        a -= way * share * w * w * np.sin(w * t + phase)
    return q, v, a


def write_run(folder, t, names, position, effort):
    state, header, time = [TYPES.types[k] for k in (STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")]
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/joint_states", STATE, typestore=TYPES)
        for k, at in enumerate(t):
            nanos = 1_700_000_000_000_000_000 + int(round(at * 1e9))
            stamp = time(sec=nanos // 10**9, nanosec=nanos % 10**9)
            message = state(
                header=header(stamp=stamp, frame_id=""), name=names, position=position[k], velocity=np.zeros(0), effort=effort[k]
            )
            writer.write(topic, nanos, TYPES.serialize_cdr(message, STATE))


def record(folder, robot, hidden, beside, rate, seed):
    """Writes the runs; gives the hidden friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(SECONDS * rate)) / rate
    places = {n: rng.uniform(-0.3, 0.3) * range_of(robot.joint(n))[1] + range_of(robot.joint(n))[0] for n in robot.names}
    friction = None
    for run in range(RUNS):
        q, v, a = {}, {}, {}
        for name in robot.names:
            still = np.zeros_like(t)
            q[name], v[name], a[name] = np.full_like(t, places[name]), still, still
            if name == hidden or name in beside:
                q[name], v[name], a[name] = sines(rng, t, *range_of(robot.joint(name)))
        for name, mimic in robot.mimics.items():
            leader = mimic.get("joint")
            factor, offset = float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
            q[name], v[name], a[name] = factor * q[leader] + offset, factor * v[leader], factor * a[leader]
        u = robot.efforts(q, v, a)
        for name in robot.names:
            damping, own = robot.own_friction(name)
            u[name] = u[name] + damping * v[name] + own * np.tanh(v[name] / SMOOTH)
        if friction is None:
            friction = HIDDEN * float(np.std(u[hidden]))
        u[hidden] = u[hidden] + friction * np.tanh(v[hidden] / SMOOTH)
        logged = [n for n in robot.names]
        size = {n: EFFORT_NOISE * np.sqrt(np.mean(u[n] ** 2)) for n in logged}
        position = np.stack([q[n] + rng.normal(0, POSITION_NOISE, len(t)) for n in logged], axis=1)
        effort = np.stack([u[n] + rng.normal(0, 1, len(t)) * size[n] for n in logged], axis=1)
        write_run(folder / f"run_{run}", t, logged, position, effort)
    return friction


def main():
    program, work, *wanted = sys.argv[1:]
    results = {}
    for seed, (name, (urdf, hidden, beside, rate)) in enumerate(ROBOTS.items()):
        if hidden is None or (wanted and name not in wanted):
            continue
        folder = Path(work) / name
        folder.mkdir(parents=True)
        path = Path(pybullet_data.getDataPath()) / urdf
        friction = record(folder, Robot(path), hidden, beside, rate, seed)
        runs = [folder / f"run_{run}" for run in range(RUNS)]
        command = [program, "diagnose", path, *runs, "--out", folder / "diagnosis"]
        ended = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
        result = {"hidden": hidden, "friction": friction, "exit": ended.returncode, "message": ended.stderr[-2000:]}
        report = folder / "diagnosis/report.json"
        if report.exists():
            read = json.loads(report.read_text())
            result |= {key: read[key] for key in ("verdict", "findings", "effort_hold", "warnings")}
        results[name] = result
    print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
