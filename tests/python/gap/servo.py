"""Joints under a position controller of unknown gains, without efforts: made in MuJoCo, diagnosed and scored.

usage: servo.py PROGRAM OUT [--seeds A:B] [--noise low,mid,high]

Five effects and one case with nothing hidden at each noise and seed, the objects of generate.py in turn. A bag holds measured positions
on /joint_states and the commanded ones on /joint_commands; the program is told nothing of the servo.
"""

import argparse
import json
import subprocess
import zlib
from pathlib import Path

import generate as suite
import numpy as np

EFFECTS = ["coulomb_friction", "stribeck_friction", "constant_bias", "spring_return", "load_dependent_friction", "nothing"]
OBJECTS = ["door", "drawer", "lid"]
STIFFER = 2.0
START_NANOS = 1_760_000_000_000_000_000


def record(name, hidden, rng, duration_s, noise, run):
    """Stamps, measured and commanded positions of one run; the servo's gains are those of the suite's operator, stiffer."""
    part = suite.PARTS[name]
    plant, operator = suite.Plant([name], hidden, run), suite.Operator(part, rng, duration_s, True)
    plant.data.qpos[0] = operator.start
    substeps = round(1 / suite.RATE_HZ / suite.STEP_S)
    times, seen, commanded = [], [], []
    for k in range(round(duration_s * suite.RATE_HZ)):
        t = k / suite.RATE_HZ
        began, kind, length, at, goal, rate, share = next(e for e in reversed(operator.plan) if e[0] <= t)
        command = goal if kind == "step" else at + (goal - at) * min(1.0, (t - began) / length)
        if kind == "shake":
            command = at + 0.06 * share * (operator.high - operator.low) * np.sin(2 * np.pi * rate * (t - began))
        times.append(t)
        seen.append(plant.measure()[name])
        commanded.append(command)
        for _ in range(substeps):
            error = command - plant.measure()[name]
            plant.step({name: STIFFER * part["kp"] * error - part["kd"] * plant.data.qvel[0]})
    return np.array(times), np.array(seen) + suite.NOISE[noise][0] * rng.standard_normal(len(seen)), np.array(commanded)


def write_bag(folder, joint, times, measured, commanded):
    header, state, stamp = (suite.TYPES.types[n] for n in ("std_msgs/msg/Header", "sensor_msgs/msg/JointState", "builtin_interfaces/msg/Time"))
    empty = np.array([])
    with suite.Writer(folder, version=9, storage_plugin=suite.StoragePlugin.MCAP) as writer:
        topics = [writer.add_connection(t, state.__msgtype__, typestore=suite.TYPES) for t in ("/joint_states", "/joint_commands")]
        for t, *values in zip(times, measured, commanded):
            nanos = START_NANOS + round(t * 1e9)
            own = header(stamp=stamp(sec=nanos // 10**9, nanosec=nanos % 10**9), frame_id="")
            for topic, value in zip(topics, values):
                message = state(header=own, name=[joint], position=np.array([value]), velocity=empty, effort=empty)
                writer.write(topic, nanos + 150_000, suite.TYPES.serialize_cdr(message, state.__msgtype__))


def make(folder, name, effect, noise, seed, runs=3, duration_s=12):
    rng = np.random.default_rng(zlib.crc32(f"servo/{name}/{effect}/{noise}/{seed}".encode()))
    hidden = {} if effect == "nothing" else {name: {effect: suite.draw(effect, suite.PARTS[name], rng)}}
    folder.mkdir(parents=True)
    (folder / "twin.urdf").write_text(suite.urdf([name]))
    for run in range(runs):
        write_bag(folder / f"run_{run}", f"{name}_joint", *record(name, hidden, rng, duration_s, noise, run))
    return hidden


def diagnose(program, folder):
    runs = sorted(folder.glob("run_*"))
    done = subprocess.run([program, "diagnose", folder / "twin.urdf", *runs, "--out", folder / "diagnosis", "--force"], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        return {"verdict": "failed", "findings": [], "actuators": [], "why": done.stderr[-300:]}
    return json.loads((folder / "diagnosis" / "report.json").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", default="1:2")
    parser.add_argument("--noise", default="low,mid,high")
    args = parser.parse_args()
    first, last = map(int, args.seeds.split(":"))
    right, named, nothing, stiffness = {}, 0, 0, []
    for seed in range(first, last):
        for noise in args.noise.split(","):
            for index, effect in enumerate(EFFECTS):
                name = OBJECTS[(index + seed) % len(OBJECTS)]
                folder = args.out / f"{name}_{effect}_{noise}_{seed}"
                make(folder, name, effect, noise, seed)
                report = diagnose(args.program, folder)
                found = [f["effect"] for f in report["findings"]]
                for actuator in report["actuators"]:
                    value = next(p["value"] for p in actuator["parameters"] if p["name"] == "stiffness")
                    stiffness.append(abs(value / (STIFFER * suite.PARTS[name]["kp"]) - 1))
                if effect == "nothing":
                    nothing, named = nothing + 1, named + bool(found)
                else:
                    right.setdefault(noise, []).append(found == [effect])
                print(f"{folder.name}: {report['verdict']} {found} {report.get('why', '')}", flush=True)
    for noise, cases in right.items():
        print(f"noise {noise}: {sum(cases)} of {len(cases)} names right")
    print(f"nothing hidden: a name in {named} of {nothing}; stiffness off by {np.median(stiffness):.4f} in the median, {max(stiffness):.4f} at most")


if __name__ == "__main__":
    main()
