"""Recordings of an arm of two joints and a drawer in its lower part, in MuJoCo, as bags: joints that share a chain.

usage: chain.py OUT [--friction N_M] [--seed N] [--runs N]     twin.urdf and run_* bags; friction hides at the second joint
       chain.py --values     qfrc_inverse of the chain in src/gap/chain_tests.rs
"""

import argparse
import sys
from pathlib import Path

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

# name: (kind, position in the parent, axis, mass, center, inertia, damping, gains, top effort)
LINKS = {
    "upper": ("hinge", (0, 0, 1), (0, -1, 0), 2.0, (0.2, 0.05, 0.0), (0.02, 0.03, 0.04), 0.2, (60.0, 9.0), 40.0),
    "lower": ("hinge", (0.4, 0, 0.1), (0, 0.6, 0.8), 1.0, (0.15, 0.0, 0.03), (0.01, 0.02, 0.015), 0.1, (25.0, 3.0), 15.0),
    "slide": ("slide", (0.3, 0, 0), (0.8, 0, 0.6), 0.5, (0.02, 0.01, 0.0), (0.001, 0.002, 0.003), 0.5, (120.0, 15.0), 20.0),
}
STEP_S = 0.0005
SIGMA_RAD, EFFORT_NOISE = 2e-4, 0.005


def text(values):
    return " ".join(f"{v:.12g}" for v in values)


def mjcf(friction, damped=True):
    body = ""
    for name, (kind, at, axis, mass, com, inertia, damping, _, _) in reversed(LINKS.items()):
        loss = f' frictionloss="{friction}"' if name == "lower" and friction else ""
        body = (
            f'<body name="{name}" pos="{text(at)}"><joint name="{name}" type="{kind}" axis="{text(axis)}" damping="{damping if damped else 0}"{loss}/>'
            f'<inertial pos="{text(com)}" mass="{mass}" diaginertia="{text(inertia)}"/>{body}</body>'
        )
    return f'<mujoco><compiler angle="radian"/><option timestep="{STEP_S}" gravity="0 0 -9.81" integrator="implicitfast"/><worldbody>{body}</worldbody></mujoco>'


def urdf():
    lines, parent = ['<?xml version="1.0"?>', '<robot name="arm">', '  <link name="base"/>'], "base"
    for name, (kind, at, axis, mass, com, i, damping, _, _) in LINKS.items():
        lines.append(
            f'  <link name="{name}"><inertial><origin xyz="{text(com)}"/><mass value="{mass}"/>'
            f'<inertia ixx="{i[0]}" ixy="0" ixz="0" iyy="{i[1]}" iyz="0" izz="{i[2]}"/></inertial></link>'
        )
        lines.append(
            f'  <joint name="{name}_joint" type="{"revolute" if kind == "hinge" else "prismatic"}"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{text(at)}"/><axis xyz="{text(axis)}"/><limit lower="-3" upper="3" effort="100" velocity="20"/>'
            f'<dynamics damping="{damping}" friction="0"/></joint>'
        )
        parent = name
    return "\n".join([*lines, "</robot>", ""])


def record(friction, rng, duration_s=10.0):
    """One run at 200 Hz: PD to random goals with the nominal gravity carried, efforts held between samples."""
    model = mujoco.MjModel.from_xml_string(mjcf(friction))
    data = mujoco.MjData(model)
    low, high = np.array([-0.8, -1.2, -0.1]), np.array([0.8, 1.2, 0.2])
    gains, top = np.array([link[7] for link in LINKS.values()]), np.array([link[8] for link in LINKS.values()])
    data.qpos[:] = rng.uniform(low, high)
    goal, until = rng.uniform(low, high), np.zeros(3)
    times, seen, efforts = [], [], []
    for k in range(round(duration_s * 200)):
        t = k / 200
        due = until <= t
        goal = np.where(due, rng.uniform(low, high), goal)
        until = np.where(due, t + rng.uniform(0.4, 1.2, 3), until)
        mujoco.mj_forward(model, data)
        effort = np.clip(gains[:, 0] * (goal - data.qpos) - gains[:, 1] * data.qvel + data.qfrc_bias, -top, top)
        times.append(t)
        seen.append(data.qpos.copy())
        efforts.append(effort)
        data.qfrc_applied[:] = effort
        for _ in range(round(1 / 200 / STEP_S)):
            mujoco.mj_step(model, data)
    seen, efforts = np.array(seen), np.array(efforts)
    noisy = efforts + EFFORT_NOISE * np.sqrt((efforts**2).mean(0)) * rng.standard_normal(efforts.shape)
    return np.array(times), seen + SIGMA_RAD * rng.standard_normal(seen.shape), noisy


def values():
    model = mujoco.MjModel.from_xml_string(mjcf(0, damped=False))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = [0.7, -0.4, 0.12], [1.3, -2.1, 0.5], [-3.0, 4.0, 2.5]
    mujoco.mj_inverse(model, data)
    print(", ".join(f"{x:.12f}" for x in data.qfrc_inverse))


def main():
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("out", type=Path, nargs="?")
    a.add_argument("--friction", type=float, default=0.0)
    a.add_argument("--seed", type=int, default=0)
    a.add_argument("--runs", type=int, default=3)
    a.add_argument("--values", action="store_true")
    o = a.parse_args()
    if o.values:
        return values()
    from generate import write_bag

    o.out.mkdir(parents=True, exist_ok=True)
    (o.out / "twin.urdf").write_text(urdf())
    rng = np.random.default_rng(o.seed)
    for r in range(o.runs):
        write_bag(o.out / f"run_{r}", list(LINKS), *record(o.friction, rng))


if __name__ == "__main__":
    main()
