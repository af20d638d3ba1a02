"""The refit of three parameters beside `mujoco.sysid`, on the same recordings: damping, friction and inertia of the door.

`mujoco.sysid` gets windows of 1 s with exact start states (from the simulation; no recording holds them) or with estimated
ones (a quadratic through 11 measured positions), and the effort held at its own step. The program gets the runs as bags and
estimates start states itself; its time is that of the whole process, which also proves the result on a further run.

needs: pip install "mujoco[sysid]" rosbags
usage: refit.py PROGRAM [--seeds A:B] [--table FILE]
"""

import argparse
import contextlib
import datetime
import io
import json
import logging
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).resolve().parents[2] / "tests/python/gap")]
import generate
import mujoco
import numpy as np
from mujoco import sysid

RUNS, SECONDS, STEP_S = 3, 10.0, 0.001
PART = generate.PARTS["door"]
NOMINAL = dict(damping=PART["damping"], friction=0.0, inertia=0.0)
NAMES = {"damping": ("viscous_friction", "damping"), "friction": ("coulomb_friction", "friction"), "inertia": ("inertia", "added_inertia")}


def record(hidden, rng, noise):
    """One run: stamps, measured positions and efforts, and the true positions and velocities."""
    plant, operator = generate.Plant(["door"], {"door": hidden}, 0), generate.Operator(PART, rng, SECONDS, True)
    plant.data.qpos[0] = operator.start
    rows = []
    for k in range(round(SECONDS * generate.RATE_HZ)):
        t, q, v = k / generate.RATE_HZ, plant.data.qpos[0], plant.data.qvel[0]
        u = operator.effort(t, q, v)
        rows.append((t, q, v, u))
        for _ in range(round(1 / generate.RATE_HZ / generate.STEP_S)):
            plant.step({"door": u})
    t, q, v, u = np.array(rows).T
    sigma, share = generate.NOISE[noise]
    seen = q + sigma * rng.standard_normal(q.shape)
    return t, seen, u + share * np.sqrt((u**2).mean()) * rng.standard_normal(u.shape), q, v


def estimated(t, y, k):
    """Position and velocity at sample k: a quadratic through the samples about it."""
    near = slice(max(0, k - 5), k + 6)
    p = np.polyfit(t[near] - t[k], y[near], 2)
    return p[2], p[1]


def by_sysid(runs, exact):
    """Estimates and CPU seconds of mujoco.sysid."""
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="{STEP_S}" gravity="0 0 0" integrator="implicitfast"/><worldbody><body><joint name="door" axis="0 0 1" damping="{PART["damping"]}"/>'
        f'<inertial pos="{PART["com"][0]} 0 0" mass="{PART["mass"]}" diaginertia="{" ".join(str(i) for i in generate.inertia(PART))}"/></body></worldbody>'
        '<actuator><motor name="motor" joint="door"/></actuator><sensor><jointpos name="position" joint="door"/></sensor></mujoco>'
    )
    model = spec.compile()
    params = sysid.ParameterDict()
    write = {
        "damping": lambda s, p: s.joint("door").damping.__setitem__(0, p.value[0]),
        "friction": lambda s, p: s.joint("door").__setattr__("frictionloss", p.value[0]),
        "inertia": lambda s, p: s.joint("door").__setattr__("armature", p.value[0]),
    }
    for name, (low, high, start) in dict(damping=(0.0, 5.0, 0.3), friction=(0.0, 5.0, 0.05), inertia=(0.0, 3.0, 0.05)).items():
        params.add(sysid.Parameter(name, start, low, high, modifier=write[name]))
    names, starts, controls, sensors = [], [], [], []
    length, sub = generate.RATE_HZ, round(1 / generate.RATE_HZ / STEP_S)
    for r, (t, y, u, q, v) in enumerate(runs):
        for first in range(0, len(t) - length, length):
            state = (q[first], v[first]) if exact else estimated(t, y, first)
            starts.append(sysid.create_initial_state(model, np.array([state[0]]), np.array([state[1]]), np.array([])))
            held = np.repeat(u[first : first + length], sub)[:, None]
            controls.append(sysid.TimeSeries(np.arange(len(held)) * STEP_S, held))
            own = y[first : first + length][:, None]
            sensors.append(sysid.TimeSeries.from_names(np.arange(len(own)) / generate.RATE_HZ, own, model))
            names.append(f"run{r}_{first}")
    sequences = sysid.ModelSequences("door", spec, names, starts, controls, sensors)
    before = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        found, _ = sysid.optimize(initial_params=params, residual_fn=sysid.build_residual_fn(models_sequences=[sequences]), verbose=False)
    return {n: float(found[n].value[0]) for n in NAMES}, time.process_time() - before


def by_program(program, runs, folder):
    """Estimates and CPU seconds of the program; the last run is held out."""
    (folder / "twin.urdf").write_text(generate.urdf(["door"]))
    paths = []
    for i, (t, y, u, _, _) in enumerate(runs):
        paths.append(folder / f"run_{i}")
        generate.write_bag(paths[-1], ["door"], t, y[:, None], u[:, None])
    command = [program, "diagnose", folder / "twin.urdf", *paths, "--held-out", paths[-1], "--out", folder / "out"]
    command += ["--effects", ",".join(effect for effect, _ in NAMES.values())]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True, env=os.environ | {"RAYON_NUM_THREADS": "1"})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = json.loads((folder / "out" / "report.json").read_text())
    found = {f["effect"]: {p["name"]: p["value"] for p in f["parameters"]} for f in report["findings"]}
    value = lambda n: NOMINAL[n] + found.get(NAMES[n][0], {}).get(NAMES[n][1], float("nan"))
    return {n: value(n) for n in NAMES}, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("program", type=Path)
    a.add_argument("--seeds", default="0:2")
    a.add_argument("--noise", nargs="*", default=["low", "mid"])
    a.add_argument("--table", type=Path)
    o = a.parse_args()
    logging.disable(logging.WARNING)
    first, last = (int(x) for x in o.seeds.split(":"))
    rows, errors = [], {}
    for noise in o.noise:
        for seed in range(first, last):
            rng = np.random.default_rng(seed)
            truth = dict(damping=0.3 + rng.uniform(0.2, 0.8), friction=rng.uniform(0.3, 1.2), inertia=rng.uniform(0.15, 0.6))
            hidden = dict(viscous_friction=dict(b=truth["damping"] - 0.3), coulomb_friction=dict(F=truth["friction"]), inertia=dict(I=truth["inertia"]))
            runs = [record(hidden, rng, noise) for _ in range(RUNS + 1)]
            with tempfile.TemporaryDirectory() as folder:
                results = {"artitwin": by_program(o.program, runs, Path(folder))}
            results["mujoco.sysid, exact start states"] = by_sysid(runs[:RUNS], True)
            results["mujoco.sysid, estimated start states"] = by_sysid(runs[:RUNS], False)
            for tool, (found, cpu) in results.items():
                off = {n: 100 * (found[n] / truth[n] - 1) for n in NAMES}
                rows.append(f"| {noise} | {seed} | {tool} | " + " | ".join(f"{found[n]:.4f} ({off[n]:+.1f} %)" for n in NAMES) + f" | {cpu:.2f} |")
                errors.setdefault((noise, tool), []).append((max(abs(x) for x in off.values()), cpu))
                print(rows[-1], flush=True)
            truths = " | ".join(f"{truth[n]:.4f}" for n in NAMES)
            rows.append(f"| {noise} | {seed} | truth | {truths} | |")
    text = f"Refit of three parameters of a door, {RUNS} runs of {SECONDS:g} s, mujoco {mujoco.__version__}, {datetime.date.today().isoformat()}, seeds {o.seeds}. Made by `refit.py`.\n"
    text += "`mujoco.sysid` rolls out in steps of 1 ms; the recordings were made in steps of 0.5 ms.\n\n"
    text += "| noise | tool | largest error of the three, median over the seeds, % | CPU, median, s |\n|---|---|---|---|\n"
    for (noise, tool), own in errors.items():
        text += f"| {noise} | {tool} | {np.median([e for e, _ in own]):.2f} | {np.median([c for _, c in own]):.2f} |\n"
    text += "\n| noise | seed | tool | damping, N m s/rad | friction, N m | added inertia, kg m^2 | CPU, s |\n|---|---|---|---|---|---|---|\n"
    text += "\n".join(rows) + "\n"
    print(text)
    if o.table:
        o.table.write_text(text)


if __name__ == "__main__":
    main()
