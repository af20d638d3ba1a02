"""Friction hidden in one joint of robots whose URDFs others wrote: is it named, alone, and how large?

    python eval/gap/robots.py PROGRAM WORK [NAME...]

The URDFs are those of `pybullet_data`. One joint follows sums of sines, the others stand; efforts are those of inverse dynamics
(PyBullet), with friction, and sampled with the positions at 200 Hz. Needs mujoco, numpy, pybullet and rosbags.
"""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pybullet
import pybullet_data

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests/python/gap"))
import generate

RATE_HZ = 200
RUN_S = 12.0
# Name, file, joint; None: the second that moves.
ROBOTS = {
    "kuka_iiwa": ("kuka_iiwa/model.urdf", None),
    "kuka_iiwa_limits": ("kuka_iiwa/model_vr_limits.urdf", None),
    "franka_panda": ("franka_panda/panda.urdf", "panda_joint4"),
    "xarm6": ("xarm/xarm6_robot.urdf", "joint3"),
    "xarm6_white": ("xarm/xarm6_robot_white.urdf", "joint2"),
    "xarm6_gripper": ("xarm/xarm6_with_gripper.urdf", "joint3"),
    "a1": ("a1/a1.urdf", None),
    "aliengo": ("aliengo/aliengo.urdf", None),
    "laikago": ("laikago/laikago.urdf", None),
    "laikago_toes": ("laikago/laikago_toes_limits.urdf", None),
    "mini_cheetah": ("mini_cheetah/mini_cheetah.urdf", None),
    "microtaur": ("quadruped/microtaur/microtaur.urdf", None),
    "minitaur": ("quadruped/minitaur.urdf", None),
    "minitaur_v1": ("quadruped/minitaur_v1.urdf", None),
    "spirit40": ("quadruped/spirit40.urdf", None),
    "vision60": ("quadruped/vision60.urdf", None),
    "quadruped": ("quadruped/quadruped.urdf", None),
    "biped2d": ("biped/biped2d_pybullet.urdf", None),
    "pendulum5": ("pendulum5.urdf", None),
    "cartpole": ("cartpole.urdf", "cart_to_pole"),
    "r2d2": ("r2d2.urdf", "head_swivel"),
    "husky": ("husky/husky.urdf", None),
}
MOVING = (pybullet.JOINT_REVOLUTE, pybullet.JOINT_PRISMATIC)


def loaded(file):
    body = pybullet.loadURDF(str(file), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    infos = [pybullet.getJointInfo(body, i) for i in range(pybullet.getNumJoints(body))]
    return body, [i for i in infos if i[2] in MOVING]


def track(joint, time_s, run, rng):
    """Position, velocity and acceleration: three sines about the middle of the range."""
    low, high = joint[8], joint[9]
    is_limited = low < high
    half = min(0.4 * (high - low), 0.8) if is_limited else 0.8
    if joint[2] == pybullet.JOINT_PRISMATIC:
        half = min(half, 0.1)
    motion = np.zeros((3, len(time_s)))
    for frequency, share in ((0.31, 0.6), (0.73, 0.27), (1.37, 0.13)):
        w, phase = 2 * np.pi * frequency * (1 + 0.1 * run), rng.uniform(0, 2 * np.pi)
        x = w * time_s + phase
        motion += half * share * np.array([np.sin(x), w * np.cos(x), -w * w * np.sin(x)])
    motion[0] += 0.5 * (low + high) if is_limited else 0.0
    return motion


def torques(body, joints, moved, motion):
    rest = [0.5 * (j[8] + j[9]) if j[8] < j[9] else 0.0 for j in joints]
    out = np.zeros((motion.shape[1], len(joints)))
    zero = [0.0] * len(joints)
    for k, (q, v, a) in enumerate(motion.T):
        state = [list(rest), list(zero), list(zero)]
        for values, value in zip(state, (q, v, a)):
            values[moved] = value
        out[k] = pybullet.calculateInverseDynamics(body, *state)
    return np.array(rest), out


def made_case(name, work):
    """The twin's file, its runs, the joint and the hidden friction."""
    file, wanted = ROBOTS[name]
    file = Path(pybullet_data.getDataPath()) / file
    pybullet.resetSimulation()
    pybullet.setGravity(0, 0, -9.81)
    body, joints = loaded(file)
    names = [j[1].decode() for j in joints]
    moved = names.index(wanted) if wanted else min(1, len(names) - 1)
    rng = np.random.default_rng(sum(map(ord, name)))
    time_s = np.arange(0, RUN_S, 1 / RATE_HZ)
    damping, own_friction = joints[moved][6], joints[moved][7]
    runs, friction = [], None
    for run in range(3):
        motion = track(joints[moved], time_s, run, rng)
        rest, effort = torques(body, joints, moved, motion)
        size = np.sqrt(np.mean(effort[:, moved] ** 2))
        friction = 0.15 * size if friction is None else friction
        effort[:, moved] += damping * motion[1] + (own_friction + friction) * np.sign(motion[1])
        position = np.tile(rest, (len(time_s), 1))
        position[:, moved] = motion[0]
        position += rng.normal(0, 1e-4, position.shape) * (np.arange(len(names)) == moved)
        effort += rng.normal(0, 0.005 * size, effort.shape)
        folder = work / name / f"run_{run}"
        shutil.rmtree(folder, ignore_errors=True)
        generate.write_joint_states(folder, names, time_s, position, effort)
        runs.append(folder)
    return file, runs, names[moved], friction


def row(program, name, work):
    twin, runs, joint, friction = made_case(name, work)
    begun = time.time()
    out = work / name / "diagnosis"
    command = [program, "diagnose", twin, *runs, "--out", out, "--force"]
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    seconds = time.time() - begun
    (work / name / "said.txt").write_text(ended.stdout + ended.stderr)
    if ended.returncode not in (0, 3):
        reason = (ended.stderr.strip().splitlines() or [""])[-1].replace("|", "/")
        return "refused", f"| {name} | {joint} | {friction:.3g} | refused: {reason[:160]} | | {seconds:.0f} |"
    report = json.loads((out / "report.json").read_text())
    found = [(f["joint"], f["effect"], f["parameters"][0]["value"], f["weight"]) for f in report["findings"]]
    own = [f for f in found if f[:2] == (joint, "coulomb_friction")]
    off = 100 * (own[0][2] / friction - 1) if own else float("nan")
    is_right = len(found) == 1 and own and report["verdict"] == "named"
    words = "; ".join(f"{j}: {e} {v:.3g} ({w:.2f})" for j, e, v, w in found) or report["verdict"]
    verdict = "right" if is_right else "with others" if own else "wrong" if found else report["verdict"]
    return verdict, f"| {name} | {joint} | {friction:.3g} | {verdict}: {words} | {off:+.1f} | {seconds:.0f} |"


def main():
    program, work, *names = sys.argv[1:]
    pybullet.connect(pybullet.DIRECT)
    print("| robot | joint | hidden friction, N m or N | found | off, % | s |\n|---|---|---|---|---|---|")
    verdicts = []
    for name in names or ROBOTS:
        verdict, line = row(program, name, Path(work))
        verdicts.append(verdict)
        print(line, flush=True)
    counts = {v: verdicts.count(v) for v in sorted(set(verdicts))}
    print(f"\nOf {len(verdicts)}: " + ", ".join(f"{v} {n}" for v, n in counts.items()) + ".")


if __name__ == "__main__":
    main()
