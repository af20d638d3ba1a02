"""Servo cases of the blind suite: joints under a position controller of unknown gains, without efforts, made in MuJoCo.

A bag holds measured positions on /joint_states and the commanded ones on /joint_commands; the program is told nothing of the servo.
"""

import json
import zlib

import generate
import numpy as np

STIFFER = 2.0
START_NANOS = 1_760_000_000_000_000_000


def record(name, hidden, rng, duration_s, noise, run):
    """Stamps, measured and commanded positions of one run; the servo's gains are those of the operator, stiffer."""
    part = generate.PARTS[name]
    plant, operator = generate.Plant([name], hidden, run), generate.Operator(part, rng, duration_s, True)
    plant.data.qpos[0] = operator.start
    times, seen, commanded = [], [], []
    for k in range(round(duration_s * generate.RATE_HZ)):
        t = k / generate.RATE_HZ
        began, kind, length, at, goal, rate, share = next(e for e in reversed(operator.plan) if e[0] <= t)
        command = goal if kind == "step" else at + (goal - at) * min(1.0, (t - began) / length)
        if kind == "shake":
            command = at + 0.06 * share * (operator.high - operator.low) * np.sin(2 * np.pi * rate * (t - began))
        times.append(t)
        seen.append(plant.measure()[name])
        commanded.append(command)
        for _ in range(generate.SUBSTEPS):
            error = command - plant.measure()[name]
            plant.step({name: STIFFER * part["kp"] * error - part["kd"] * plant.data.qvel[0]})
    return np.array(times), np.array(seen) + generate.NOISE[noise][0] * rng.standard_normal(len(seen)), np.array(commanded)


def write_bag(folder, joint, times, measured, commanded):
    header, state, stamp = (generate.TYPES.types[n] for n in ("std_msgs/msg/Header", "sensor_msgs/msg/JointState", "builtin_interfaces/msg/Time"))
    empty = np.array([])
    with generate.Writer(folder, version=9, storage_plugin=generate.StoragePlugin.MCAP) as writer:
        topics = [writer.add_connection(t, state.__msgtype__, typestore=generate.TYPES) for t in ("/joint_states", "/joint_commands")]
        for t, *values in zip(times, measured, commanded):
            nanos = START_NANOS + round(t * 1e9)
            own = header(stamp=stamp(sec=nanos // 10**9, nanosec=nanos % 10**9), frame_id="")
            for topic, value in zip(topics, values):
                message = state(header=own, name=[joint], position=np.array([value]), velocity=empty, effort=empty)
                writer.write(topic, nanos + 150_000, generate.TYPES.serialize_cdr(message, state.__msgtype__))


def write_case(out, name, obj, effects, noise, seed, runs, duration_s):
    """As `generate.write_case`; the truth has the servo's stiffness, too."""
    effect = effects[0] if effects else "nothing"
    rng = np.random.default_rng(zlib.crc32(f"servo/{obj}/{effect}/{noise}/{seed}".encode()))
    part = generate.PARTS[obj]
    hidden = {obj: {effect: generate.draw(effect, part, rng)}} if effects else {}
    folder = out / name
    folder.mkdir(parents=True)
    (folder / "twin.urdf").write_text(generate.urdf([obj]))
    for run in range(runs):
        write_bag(folder / f"run_{run}", f"{obj}_joint", *record(obj, hidden, rng, duration_s, noise, run))
    truth = dict(object=obj, hidden=hidden, noise=noise, position_sigma=generate.NOISE[noise][0], seed=seed, stiffness=STIFFER * part["kp"])
    (out / "truth").mkdir(exist_ok=True)
    (out / "truth" / f"{name}.json").write_text(json.dumps(truth, indent=1))
