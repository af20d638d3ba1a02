"""Rolls the exported `twin.xml`, with the effects that it lacks (`artitwin.effects`), out in MuJoCo over the held-out windows of a
diagnosis, from the start states in `replay.json`, with the recorded efforts held from sample to sample. Prints, for each joint, the root mean square
residual, and `after` of the report.

usage: replay.py RESULT RUN...
"""

import json
import math
import sys
from pathlib import Path

import mujoco
import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

sys.path[:0] = [str(Path(__file__).resolve().parents[3] / "python")]
from artitwin.effects.mujoco import MujocoEffects

TYPES = get_typestore(Stores.ROS2_JAZZY)


def read(run):
    """Stamps from the first of the recording, and {joint: (positions, efforts)}."""
    stamps, rows = [], {}
    with Reader(run) as reader:
        for connection, _, raw in reader.messages():
            if connection.msgtype != "sensor_msgs/msg/JointState":
                continue
            m = TYPES.deserialize_cdr(raw, connection.msgtype)
            stamps.append(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec)
            for i, name in enumerate(m.name):
                rows.setdefault(name, []).append((m.position[i], m.effort[i]))
    time_s = (np.array(stamps) - stamps[0]) * 1e-9
    return time_s, {name: np.array(r).T for name, r in rows.items()}


def residuals(effects, model, data, joint, window, time_s, joints):
    """Measured minus simulated positions of one window; other joints are where they were recorded."""
    position, effort = joints[joint]
    u = model.actuator(joint).id
    first = int(np.searchsorted(time_s, window["start_s"] - 1e-6))
    mujoco.mj_resetData(model, data)
    data.time = time_s[first]
    effects.start_at(joint, data, window["position"], window["velocity"], window["play"])
    for i in range(model.nu if model.nhistory else 0):
        # What was commanded before the window, one entry a step.
        count = int(model.actuator_history[i, 0])
        if count > 0:
            times = time_s[first] - model.opt.timestep * np.arange(count, 0, -1)
            held = np.clip(np.searchsorted(time_s, times + 1e-9, side="right") - 1, 0, None)
            mujoco.mj_initCtrlHistory(model, data, i, times, np.ascontiguousarray(effort[held][:, None]))
    left = []
    for k in range(first, first + window["samples"]):
        left.append(position[k] - effects.reading(joint, data))
        if k + 1 == first + window["samples"]:
            break
        for other, (positions, _) in joints.items():
            if other != joint:
                data.joint(other).qpos, data.joint(other).qvel = np.mean(positions[k : k + 2]), 0.0
        data.ctrl[:] = 0
        data.ctrl[u] = effects.command(joint, data.time, effort[k])
        for _ in range(round((time_s[k + 1] - time_s[k]) / model.opt.timestep)):
            mujoco.mj_step(model, data)
    return left


def replay(result, runs):
    """{joint: rmse}."""
    model = mujoco.MjModel.from_xml_path(str(Path(result) / "twin.xml"))
    data = mujoco.MjData(model)
    recorded = {Path(r).name: read(r) for r in runs}
    left = {}
    with MujocoEffects(model, Path(result) / "twin.xml") as effects:
        for window in json.loads((Path(result) / "replay.json").read_text()):
            time_s, joints = recorded[window["run"]]
            left.setdefault(window["joint"], []).extend(residuals(effects, model, data, window["joint"], window, time_s, joints))
    return {joint: math.sqrt(np.mean(np.square(r))) for joint, r in left.items()}


def main():
    result, runs = Path(sys.argv[1]), sys.argv[2:]
    gap = json.loads((result / "report.json").read_text())["gap"]
    for joint, rmse in replay(result, runs).items():
        # Windows have about the same length, so that runs weigh by their samples alike.
        own = [r["after"] for r in gap["runs"] if r["joint"] == joint]
        print(json.dumps(dict(joint=joint, mujoco=rmse, after=math.sqrt(sum(a * a for a in own) / len(own)))))


if __name__ == "__main__":
    main()
