"""How much nearer an exported MJCF comes to recorded motion than the twin that it was made from, in MuJoCo, all joints together.

Runs are cut into windows of 1 s. For each window and each of the two models the start state of all joints is fitted by least
squares, so that no model is judged by another's state; the recorded efforts go through the exported actuators (gear, delay,
bias) or, of the twin, straight to its joints, held from sample to sample. Both take the step and the integrator of the exported
file. Where `effects.json` stands beside the file, it is rolled out with the effects that it lacks as well. The error of a joint is the median over the windows of its root mean square error, rad or m; that of the whole is the
median over windows of the root mean square over joints, each in units of its own motion where turns and slides mix.

usage: mjcf_error.py TWIN.urdf EXPORTED.xml RUN...
"""

import json
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "tests/python/gap")]
import replay

WINDOW_S = 1.0
ITERATIONS = 25
# Steps of the difference quotients, rad or m and rad/s or m/s.
SMALL = (1e-5, 1e-4)
# An exported model counts as worse from here on; less is the fit's own tolerance.
WORSE = 1.005


def twin_model(urdf, exported):
    """The twin as MuJoCo reads its URDF, without shapes and limits, which the exported file has not either; stepped alike."""
    root = ElementTree.parse(urdf).getroot()
    for link in root.iter("link"):
        for shape in [e for e in link if e.tag in ("visual", "collision")]:
            link.remove(shape)
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    model.jnt_limited[:] = 0
    model.opt.timestep, model.opt.integrator, model.opt.gravity[:] = exported.opt.timestep, exported.opt.integrator, exported.opt.gravity
    for j in range(model.njnt):
        # Friction as hard as in the exported file.
        mine, its = model.jnt_dofadr[j], exported.joint(model.joint(j).name).dofadr[0]
        model.dof_solref[mine], model.dof_solimp[mine] = exported.dof_solref[its], exported.dof_solimp[its]
    return model


class Bare:
    """In place of `MujocoEffects`: a model as its file has it."""

    def start_at(self, joint, data, reading, velocity):
        data.joint(joint).qpos, data.joint(joint).qvel = reading, velocity

    def command(self, joint, time_s, value):
        return value

    def reading(self, joint, data):
        return data.joint(joint).qpos[0]


class Replayed:
    """A model that repeats windows of a recording, with effects or bare."""

    def __init__(self, model, joints, effects=Bare()):
        self.model, self.data, self.joints, self.effects = model, mujoco.MjData(model), joints, effects
        self.v = [model.joint(j).dofadr[0] for j in joints]
        self.actuators = [model.actuator(j).id for j in joints] if model.nu else None

    def roll(self, state, time_s, effort, first, count):
        """Positions at `count` samples from `first` on, from `state` (positions, then speeds); one row a sample."""
        m, d, n = self.model, self.data, len(self.joints)
        mujoco.mj_resetData(m, d)
        for joint, reading, velocity in zip(self.joints, state[:n], state[n:]):
            self.effects.start_at(joint, d, reading, velocity)
        self.remember(time_s, effort, first)
        # Steps by whole times from the first sample on, so that jitter of stamps does not add up.
        steps = np.round((time_s[first : first + count] - time_s[first]) / m.opt.timestep).astype(int)
        seen = np.empty((count, n))
        for k in range(count):
            seen[k] = [self.effects.reading(joint, d) for joint in self.joints]
            if k + 1 < count:
                commands = [self.effects.command(joint, d.time, u) for joint, u in zip(self.joints, effort[first + k])]
                if self.actuators is None:
                    d.qfrc_applied[self.v] = commands
                else:
                    d.ctrl[self.actuators] = commands
                mujoco.mj_step(m, d, nstep=max(0, steps[k + 1] - steps[k]))
        return seen

    def remember(self, time_s, effort, first):
        """What was commanded before the window, for actuators that act late, one entry a step."""
        m, d = self.model, self.data
        d.time = time_s[first]
        for joint, i in enumerate(self.actuators if self.actuators is not None and m.nhistory else []):
            kept = int(m.actuator_history[i, 0])
            if kept > 0:
                times = time_s[first] - m.opt.timestep * np.arange(kept, 0, -1)
                held = np.clip(np.searchsorted(time_s, times + 1e-9, side="right") - 1, 0, None)
                mujoco.mj_initCtrlHistory(m, d, i, times, np.ascontiguousarray(effort[held, joint][:, None]))

    def fit(self, state, unit, time_s, position, effort, first, count):
        """Residuals in the joints' units of a window, with the start state that leaves least (Levenberg, Marquardt)."""
        n = len(self.joints)
        left = lambda x: ((position[first : first + count] - self.roll(x, time_s, effort, first, count)) / unit).ravel()
        steps = np.repeat(SMALL, n) * np.tile(unit, 2)
        best, damping = left(state), 1e-3
        for _ in range(ITERATIONS):
            slope = np.array([(left(state + h * e) - best) / h for h, e in zip(steps, np.eye(2 * n))]).T
            normal, cost = slope.T @ slope, best @ best
            while damping < 1e6:
                trial = state - np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), slope.T @ best)
                found = left(trial)
                if np.all(np.isfinite(found)) and found @ found < cost:
                    break
                damping *= 8
            else:
                break
            gained = 1 - (found @ found) / cost
            state, best, damping = trial, found, damping / 8
            if gained < 1e-4:
                break
        return best.reshape(count, n)


def start(time_s, position, first, count):
    """Positions and speeds at the start of a window, by a parabola through 0.05 s."""
    some = slice(first, first + max(5, int(count * 0.05)))
    c = np.polyfit(time_s[some] - time_s[first], position[some], 2)
    return np.concatenate([c[2], c[1]])


def windows(time_s):
    """(first sample, samples) of whole windows."""
    edges = np.searchsorted(time_s, time_s[0] + WINDOW_S * np.arange(int((time_s[-1] - time_s[0]) / WINDOW_S + 1e-6) + 1) - 1e-9)
    return [(a, b - a) for a, b in zip(edges, edges[1:]) if b - a >= 20]


def read(runs, joints):
    """(stamps, positions, efforts) of each run, a column a joint."""
    recorded = [replay.read(r) for r in runs]
    return [(time_s, *(np.array([rows[j][k] for j in joints]).T for k in (0, 1))) for time_s, rows in recorded]


def units(model, joints, recorded):
    """What a joint's error is divided by before joints are taken together: 1, or its own motion where turns and slides mix."""
    moved = np.sqrt(np.mean([np.var(position, axis=0) for _, position, _ in recorded], axis=0))
    return moved if len({int(model.joint(j).type[0]) for j in joints}) > 1 else np.ones(len(joints))


def window_errors(model, joints, unit, recorded, effects=Bare()):
    """Root mean square error of each window (rows) and joint, in the joints' units."""
    replayed, rows = Replayed(model, joints, effects), []
    for time_s, position, effort in recorded:
        for first, count in windows(time_s):
            state = start(time_s, position, first, count)
            rows.append(np.mean(replayed.fit(state, unit, time_s, position, effort, first, count) ** 2, axis=0))
    return np.sqrt(np.array(rows))


def medians(rows, joints, unit):
    """{joint or `all`: median over the windows}."""
    single = {j: float(np.median(rows[:, i]) * unit[i]) for i, j in enumerate(joints)}
    return single | {"all": float(np.median(np.sqrt(np.mean(rows**2, axis=1))))}


def common(twin, recorded_joints):
    """Joints of the twin that the recordings have."""
    return [name for name in (twin.joint(j).name for j in range(twin.njnt)) if name in recorded_joints]


def errors(twin, exported, runs):
    """{joint or `all`: (the twin's error, the exported model's, their ratio)}."""
    exported = mujoco.MjModel.from_xml_path(str(exported))
    twin = twin_model(twin, exported)
    joints = common(twin, replay.read(runs[0])[1])
    recorded = read(runs, joints)
    unit = units(twin, joints, recorded)
    before, after = (medians(window_errors(model, joints, unit, recorded), joints, unit) for model in (twin, exported))
    return {name: (before[name], after[name], after[name] / before[name]) for name in before}


def errors_with_effects(file, runs):
    """{joint or `all`: error} of an exported file with the effects that it lacks."""
    model = mujoco.MjModel.from_xml_path(str(file))
    joints = common(model, replay.read(runs[0])[1])
    recorded = read(runs, joints)
    unit = units(model, joints, recorded)
    with replay.MujocoEffects(model, file) as effects:
        return medians(window_errors(model, joints, unit, recorded, effects), joints, unit)


def main():
    twin, exported, runs = Path(sys.argv[1]), Path(sys.argv[2]), [Path(r) for r in sys.argv[3:]]
    beside = errors_with_effects(exported, runs) if exported.with_name("effects.json").exists() else {}
    for joint, (before, after, ratio) in errors(twin, exported, runs).items():
        more = dict(with_effects=beside[joint], with_effects_ratio=beside[joint] / before) if beside else {}
        print(json.dumps(dict(joint=joint, twin=before, exported=after, ratio=ratio) | more))


if __name__ == "__main__":
    main()
