"""`artitwin diagnose` beside a plain regression and `mujoco.sysid`: error of the MJCF on runs that nobody was shown, and CPU time.

Every tool gets the twin and the same runs, and gives an MJCF; `mjcf_error.py` measures each on other runs, as a share of the twin's
error. The program is given nothing more. The peers are given which parameters to fit at every joint:

regression          viscous friction, Coulomb friction, offset, added inertia (all but the offset at least 0), by least squares of the
                    recorded effort less the twin's inverse dynamics; positions and efforts through one zero-phase Butterworth
                    filter, whose corner is the one of CORNERS_HZ that predicts the shown runs best; slow samples left out
sysid               damping, frictionloss, armature, gear by `mujoco.sysid.optimize`, over windows of 1 s of the shown runs; each
                    starts at a position and speed from a local parabola through the recorded positions
..., states         the same, and ROUNDS times by turns: the windows' start states by least squares, then the parameters
..., offset         the same with an offset of the effort beside the four, which the regression has too

Peers roll out in steps of 1 ms, the recorded effort held. Made machines: `machine` and `machine_null` (tests/python/gap/machine.py,
a floor on every joint), and `single` without a floor; two further runs of each are for the judge alone.

needs: pip install "mujoco[sysid]" rosbags scipy
usage: peers.py PROGRAM WORK [--measured NAME TWIN.urdf JUDGED_RUN RUN...]... [--table FILE]
`--table` replaces what follows the heading Tables of the file. Results stay in WORK/results, one file a case; a run that was stopped
goes on where it was. The recordings of measured machines are no part of the repository. For them the program runs a second time, with
the judged run as the one of its proof (`--held-out`).
"""

import argparse
import contextlib
import io
import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).resolve().parents[2] / "tests/python/gap")]
import absl.logging
import generate
import machine
import mjcf_error
import mujoco
import numpy as np
import peers_table
from mujoco import rollout, sysid
from peers_table import HELD, NOT_HELD, PROVED, TOOLS, ratio, said
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

STEP_S, WINDOW_STEPS = 0.001, 1000
CORNERS_HZ = (3.0, 6.0, 12.0, 25.0)
SLOW = 0.05  # of the root mean square speed: slower samples say little about the sign
HALF_S = 0.05  # of the parabola of a start state
ROUNDS = 2
FOUR = ("damping", "frictionloss", "armature", "gear")
FIVE = (*FOUR, "offset")
XTOL = 1e-4  # relative step; the default of 1e-8 takes three times the time to the same parameters (seen on both machines)
# Made machines without a floor: one effect that the peers' parameters hold, one that they do not.
CLEAN = ("coulomb_friction", "delay")
RUNS, SECONDS = 5, 10.0
MARK = "## Tables\n\nMade by `peers.py`. "


@dataclass
class Case:
    """A twin, the runs shown to the tools, and those of the judge."""

    name: str
    kind: str
    twin: Path
    shown: list
    judged: list
    hidden: tuple = ()  # (joint, effect) of a made machine


@dataclass
class Windows:
    """Windows of 1 s of the shown runs: start states (positions, speeds), efforts at the steps, and (times, positions) of the samples."""

    states: np.ndarray
    efforts: np.ndarray
    samples: list


# What the peers share.


def base_spec(urdf):
    """The twin as an editable MJCF with a motor at each joint, without shapes and limits."""
    root = ElementTree.parse(urdf).getroot()
    for link in root.iter("link"):
        for shape in [e for e in link if e.tag in ("visual", "collision")]:
            link.remove(shape)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.option.timestep, spec.option.integrator = STEP_S, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in spec.joints:
        joint.limited, joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE, mujoco.mjtLimited.mjLIMITED_FALSE
        spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT, biastype=mujoco.mjtBias.mjBIAS_AFFINE)
    return spec


def parabola(time_s, position, at):
    """Position and speed at sample `at`, a parabola through 0.1 s about it."""
    near = slice(*np.searchsorted(time_s, time_s[at] + np.array([-HALF_S, HALF_S])))
    c = np.polyfit(time_s[near] - time_s[at], position[near], 2)
    return np.concatenate([c[2], c[1]])


def windows(recorded):
    states, efforts, samples = [], [], []
    grid = STEP_S * np.arange(WINDOW_STEPS + 1)
    for time_s, position, effort in recorded:
        for first, count in mjcf_error.windows(time_s):
            own = time_s[first : first + count] - time_s[first]
            held = np.searchsorted(time_s, time_s[first] + grid + 1e-9, side="right") - 1
            states.append(parabola(time_s, position, first))
            efforts.append(effort[held])
            samples.append((own, position[first : first + count]))
    return Windows(np.array(states), np.array(efforts), samples)


def left(model, wins, states=None):
    """Measured less predicted positions of each window, rolled out together."""
    full = np.concatenate([np.zeros((len(wins.samples), 1)), wins.states if states is None else states], axis=1)
    seen, _ = rollout.rollout(model, mujoco.MjData(model), full, wins.efforts[:, :-1])
    grid = STEP_S * np.arange(WINDOW_STEPS + 1)
    out = []
    for start, path, (own, position) in zip(full, seen, wins.samples):
        path = np.vstack([start, path])[:, 1 : 1 + model.nq]
        out.append(position - np.array([np.interp(own, grid, p) for p in path.T]).T)
    return out


def fit_error(model, wins, unit):
    """Median over the windows of the root mean square error, in the joints' units."""
    return float(np.median([np.sqrt(np.mean((r / unit) ** 2)) for r in left(model, wins)]))


def fit_states(model, wins, unit, iterations=8):
    """The windows with the start states that leave least (Levenberg, Marquardt, each window its own damping)."""
    n, states = model.nq, wins.states.copy()
    small = np.repeat((1e-5, 1e-4), n) * np.tile(unit, 2)
    flat = lambda s: [(r / unit).ravel() for r in left(model, wins, s)]
    best, damping = flat(states), np.full(len(states), 1e-3)
    for _ in range(iterations):
        moved = [flat(states + h * e) for h, e in zip(small, np.eye(2 * n))]
        steps = []
        for w, r in enumerate(best):
            slope = np.array([(m[w] - r) / h for m, h in zip(moved, small)]).T
            normal = slope.T @ slope
            steps.append(np.linalg.solve(normal + damping[w] * np.diag(np.diag(normal) + 1e-12), slope.T @ r))
        trial = states - np.array(steps)
        found = flat(trial)
        for w, r in enumerate(found):
            better = np.all(np.isfinite(r)) and r @ r < best[w] @ best[w]
            damping[w] *= 0.1 if better else 10
            if better:
                states[w], best[w] = trial[w], r
    return replace(wins, states=states)


# The plain regression.


def smoothed(time_s, position, effort, corner_hz):
    """Positions, speeds, accelerations and efforts every 5 ms through the filter; the ends, where it settles, are left out."""
    grid = np.arange(0.0, time_s[-1], STEP_S)
    sos = butter(4, corner_hz, fs=1 / STEP_S, output="sos")
    low = lambda x: sosfiltfilt(sos, x, axis=0)
    q = low(np.array([np.interp(grid, time_s, p) for p in position.T]).T)
    u = low(effort[np.searchsorted(time_s, grid + 1e-9, side="right") - 1])
    v = np.gradient(q, STEP_S, axis=0)
    a = np.gradient(v, STEP_S, axis=0)
    edge = round(1 / corner_hz / STEP_S)
    return [x[edge:-edge:5] for x in (q, v, a, u)]


def regress(urdf, recorded, joints, corner_hz):
    """{joint: parameters} by least squares."""
    bare = base_spec(urdf)
    for joint in bare.joints:
        joint.damping[:], joint.frictionloss = 0, 0
    model = bare.compile()
    data = mujoco.MjData(model)
    q, v, a, u = (np.concatenate(x) for x in zip(*(smoothed(*run, corner_hz) for run in recorded)))
    twins = np.empty_like(u)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        twins[k] = data.qfrc_inverse
    found = {}
    for i, joint in enumerate(joints):
        fast = np.abs(v[:, i]) > SLOW * np.sqrt(np.mean(v[:, i] ** 2))
        columns = np.stack([v[:, i], np.sign(v[:, i]), a[:, i], np.ones(len(v))], axis=1)[fast]
        scale = np.sqrt(np.mean(columns**2, axis=0))
        x = lsq_linear(columns / scale, (u - twins)[fast, i], bounds=([0, 0, 0, -np.inf], np.inf)).x / scale
        found[joint] = dict(zip(("damping", "frictionloss", "armature", "offset"), (float(y) for y in x)))
    return found


def written(urdf, found):
    """The twin's MJCF with the parameters of each joint."""
    spec = base_spec(urdf)
    for joint, own in found.items():
        spec.joint(joint).damping[0], spec.joint(joint).frictionloss = own["damping"], own["frictionloss"]
        spec.joint(joint).armature = own["armature"]
        spec.actuator(joint).gear[0] = own.get("gear", 1.0)
        # The effort of the actuator is that of the joint: an offset adds to it.
        spec.actuator(joint).biasprm[0] = -own.get("offset", 0.0)
    spec.compile()
    return spec


def by_regression(case, recorded, joints, unit):
    wins = windows(recorded)
    tried = [(h, regress(case.twin, recorded, joints, h)) for h in CORNERS_HZ]
    corner, found = min(tried, key=lambda t: fit_error(written(case.twin, t[1]).compile(), wins, unit))
    return written(case.twin, found), found | {"corner_hz": corner}


# mujoco.sysid.


def parameters(spec, recorded, joints, free):
    """Those of each joint, between bounds far out, from the twin's values; off the bounds, as `optimize` asks."""
    model, params = spec.compile(), sysid.ParameterDict()
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    write = {
        "damping": lambda s, j, x: s.joint(j).damping.__setitem__(0, x),
        "frictionloss": lambda s, j, x: setattr(s.joint(j), "frictionloss", x),
        "armature": lambda s, j, x: setattr(s.joint(j), "armature", x),
        "gear": lambda s, j, x: s.actuator(j).gear.__setitem__(0, x),
        "offset": lambda s, j, x: s.actuator(j).biasprm.__setitem__(0, -x),
    }
    usual = [np.concatenate(x) for x in zip(*(smoothed(*run, 6.0) for run in recorded))]
    for i, joint in enumerate(joints):
        effort, speed = (np.sqrt(np.mean(x[:, i] ** 2)) for x in (usual[3], usual[1]))
        inertia, own = mass[i, i], spec.joint(joint)
        bounds = dict(
            damping=(0.0, 3 * effort / speed + own.damping[0], own.damping[0]), frictionloss=(0.0, 2 * effort, own.frictionloss),
            armature=(0.0, 2 * inertia, 0.0), gear=(0.3, 3.0, 1.0), offset=(-effort, effort, 0.0),
        )  # fmt: skip
        for name in free:
            low, high, at = bounds[name]
            params.add(sysid.Parameter(f"{joint}/{name}", at, low, high, modifier=lambda s, p, j=joint, f=write[name]: f(s, j, p.value[0])))
    params.move_off_bounds()
    return params


def optimized(spec, wins, joints, unit, params):
    model, grid = spec.compile(), STEP_S * np.arange(WINDOW_STEPS + 1)
    names = [(f"{j}_qpos", sysid.SignalType.MjStateQPos) for j in joints]
    n = model.nq
    # Of the state, not of a `jointpos` sensor: `mujoco.rollout` gives sensors of the step's start with the time of its end.
    sequences = sysid.ModelSequences(
        "twin", spec, [f"window_{i}" for i in range(len(wins.samples))],
        [sysid.create_initial_state(model, s[:n], s[n:]) for s in wins.states],
        [sysid.TimeSeries.from_control_names(grid, u, model) for u in wins.efforts],
        [sysid.TimeSeries.from_names(own, position, model, names=names) for own, position in wins.samples],
        allow_missing_sensors=True,
    )  # fmt: skip
    residual = sysid.build_residual_fn(models_sequences=[sequences], sensor_weights=1 / unit)
    with contextlib.redirect_stdout(io.StringIO()):
        found, _ = sysid.optimize(initial_params=params, residual_fn=residual, verbose=False, x_scale="jac", xtol=XTOL)
    return found


def by_sysid(case, recorded, joints, unit, free, rounds):
    spec, wins = base_spec(case.twin), windows(recorded)
    params = optimized(spec, wins, joints, unit, parameters(spec, recorded, joints, free))
    as_found = lambda p: {j: {name: float(p[f"{j}/{name}"].value[0]) for name in free} for j in joints}
    for _ in range(rounds):
        wins = fit_states(written(case.twin, as_found(params)).compile(), wins, unit)
        params = optimized(spec, wins, joints, unit, params)
    return written(case.twin, as_found(params)), as_found(params)


# The program.


def by_program(program, case, out, proved):
    command = [program, "diagnose", case.twin, *case.shown, "--out", out, "--force"]
    for run in case.judged if proved else []:
        command += [run, "--held-out", run]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"RAYON_NUM_THREADS": "1"})
    if not (out / "twin.xml").exists():
        raise RuntimeError(f"{case.name}: {done.stderr[-500:]}")
    report = json.loads((out / "report.json").read_text())
    return out / "twin.xml", {"verdict": report["verdict"], "findings": [[f["joint"], f["effect"]] for f in report["findings"]]}


# A case.


def judged(model, case, joints, recorded, unit):
    """Median error of the windows, that of the joint where something was hidden, or of all."""
    found = mjcf_error.medians(mjcf_error.window_errors(model, joints, unit, recorded), joints, unit)
    return found[case.hidden[0] if case.hidden else "all"]


def spent():
    """CPU seconds of this process and of those that it waited for."""
    own, others = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


def solve(program, case, folder):
    """What each tool found, its time, and its error."""
    folder.mkdir(parents=True, exist_ok=True)
    bare = base_spec(case.twin).compile()
    joints = mjcf_error.common(bare, mjcf_error.replay.read(case.shown[0])[1])
    shown, other = (mjcf_error.read(runs, joints) for runs in (case.shown, case.judged))
    unit = mjcf_error.units(bare, joints, other)
    run = {
        "artitwin": lambda out: by_program(program, case, out, False),
        PROVED: lambda out: by_program(program, case, out, True),
        "regression": lambda out: by_regression(case, shown, joints, unit),
        "sysid": lambda out: by_sysid(case, shown, joints, unit, FOUR, 0),
        "sysid, states": lambda out: by_sysid(case, shown, joints, unit, FOUR, ROUNDS),
        "sysid, offset": lambda out: by_sysid(case, shown, joints, unit, FIVE, 0),
        "sysid, offset, states": lambda out: by_sysid(case, shown, joints, unit, FIVE, ROUNDS),
    }
    found, cpu, wall, exported = {}, {}, {}, {}
    for tool in run if case.kind == "measured" else TOOLS:
        out = folder / tool.replace(", ", "_")
        before, started = spent(), time.monotonic()
        made, found[tool] = run[tool](out)
        cpu[tool], wall[tool] = spent() - before, time.monotonic() - started
        if not isinstance(made, Path):
            out.mkdir(exist_ok=True)
            (out / "twin.xml").write_text(made.to_xml())
        exported[tool] = mujoco.MjModel.from_xml_path(str(out / "twin.xml"))
    # The twin takes step and hardness of friction of the program's file.
    models = exported | {"twin": mjcf_error.twin_model(case.twin, exported["artitwin"])}
    error = {tool: judged(model, case, joints, other, unit) for tool, model in models.items()}
    wins = windows(shown)
    fitted = {tool: fit_error(model, wins, unit) for tool, model in (exported | {"twin": bare}).items() if tool not in ("artitwin", PROVED)}
    slides = bare.joint(case.hidden[0] if case.hidden else joints[0]).type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    about = dict(name=case.name, kind=case.kind, hidden=case.hidden, shown_s=sum(t[-1] for t, *_ in shown), joints=joints)
    about |= dict(unit="of its motion" if not case.hidden and np.any(unit != 1) else "m" if slides else "rad")
    return about | dict(found=found, cpu_s=cpu, wall_s=wall, fitted=fitted, error=error)


def made(kind, effects, seed):
    """The first of each of these in the suite's own order (`suite.py` draws object and noise from the seed)."""
    from suite import plan

    cases = plan(kind, (["low", "mid"], RUNS, SECONDS, 132), seed)
    if not effects:
        return cases[: 2 if kind == "machine_null" else 0]
    return [next(c for c in cases if c[2] == (e,)) for e in effects]


def write_made(case, work):
    """Makes the recordings of a case of the suite."""
    kind, obj, effects, noise, seed, runs, duration = case
    name = "_".join([obj, *(effects or ["nothing"]), noise, str(seed)])
    folder = work / "made" / kind
    if not (folder / "truth" / f"{name}.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        if kind == "single":
            generate.write_case(folder, name, obj, effects, noise, seed, runs + 2, duration)
            for k in range(2):
                (folder / name / f"run_{runs + k}").rename(folder / name / f"unseen_{k}")
        else:
            machine.write_case(folder, name, obj, effects, noise, seed, runs, duration)
    truth = json.loads((folder / "truth" / f"{name}.json").read_text())
    hidden = next(((f"{part}_joint", effect) for part, own in truth["hidden"].items() for effect in own), ())
    own = folder / name
    return Case(name, kind, own / "twin.urdf", [own / f"run_{r}" for r in range(runs)], sorted(own.glob("unseen_*")), hidden=hidden)


def main():
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("program", type=Path)
    a.add_argument("work", type=Path)
    a.add_argument("--measured", nargs="+", action="append", default=[])
    a.add_argument("--seed", type=int, default=6200)
    a.add_argument("--table", type=Path)
    o = a.parse_args()
    absl.logging.set_verbosity(absl.logging.ERROR)
    cases = []
    for name, twin, judge, *shown in o.measured:
        cases.append(Case(name, "measured", Path(twin), [Path(r) for r in shown], [Path(judge)]))
    drawn = [("machine", HELD + NOT_HELD), ("machine_null", ()), ("single", CLEAN)]
    cases += [write_made(c, o.work) for kind, effects in drawn for c in made(kind, effects, o.seed)]
    results, records = o.work / "results", []
    results.mkdir(parents=True, exist_ok=True)
    for case in cases:
        kept = results / f"{case.kind}-{case.name.replace(', ', '_').replace(' ', '_')}.json"
        if not kept.exists():
            kept.write_text(json.dumps(solve(o.program, case, o.work / "out" / kept.stem), indent=1))
        records.append(json.loads(kept.read_text()))
        print(case.name, *(f"{t}: {ratio(records[-1], t):.3f} ({records[-1]['cpu_s'][t]:.1f} s)," for t in TOOLS), said(records[-1]), flush=True)
    text = peers_table.document(records, o.program, o.seed)
    print(text)
    if o.table:
        # What stands before the mark was written by hand.
        before = o.table.read_text().split(MARK)[0] if o.table.exists() else "# Beside other tools\n\n"
        o.table.write_text(before + MARK + text)


if __name__ == "__main__":
    main()
