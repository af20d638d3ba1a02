"""Machines of the blind suite: cases whose joints have a floor (floor.py), with one hidden effect or none.

Floor and effect are drawn from the seed. The floor is 2 to 20 % of the root mean square effort; an effect has the size that
`generate.draw` gives, drawn again where it is less than twice its floor, and the floor then shrinks, not below 2 %. Two runs are
more than the program gets: `run_*` are shown to it, `unseen_*` are for the judge of the exported MJCF.
"""

import json
import zlib

import generate
import numpy as np
from floor import Floor, rms
from generate import NOISE, OBJECTS, RATE_HZ, draw, inertia_at_joint, load_effort
from scipy.signal import savgol_filter

# Of the rehearsals; single runs come to between 0.7 and 1.3 of it, and the truth says to what.
SHARES = (0.02, 0.17)
LEAST_RATIO = 2.0
DRAWS = 6
REHEARSAL_S = 8.0
SMOOTHED = 21  # samples of the inverse dynamics' local cubic


class Rehearsal:
    """A motion without noise: positions and reported efforts at the samples."""

    def __init__(self, parts, hidden, floors, seed, run=0):
        rng = np.random.default_rng(seed)
        steps = {name: (f.position_step, f.effort_step, f.jitter) for name, f in floors.items()}
        for floor in floors.values():
            floor.start(1.0)
            floor.position_step = floor.effort_step = floor.jitter = 0.0
        _, self.seen, self.reported = generate.record(parts, hidden, rng, REHEARSAL_S, None, run=run, floors=floors)
        for name, floor in floors.items():
            floor.position_step, floor.effort_step, floor.jitter = steps[name]
        self.parts = parts

    def residual(self, name):
        """Inverse dynamics of the twin without friction, less the reported effort; both through a local cubic of 0.1 s; N m or N."""
        i, part = self.parts.index(name), generate.PARTS[name]
        smooth = lambda x, order=0: savgol_filter(x, SMOOTHED, 3, deriv=order, delta=1 / RATE_HZ)
        q = self.seen[:, i]
        load = np.array([load_effort(part, x) for x in smooth(q)])
        model = inertia_at_joint(part) * smooth(q, 2) + part["damping"] * smooth(q, 1) + load
        return (model - smooth(self.reported[:, i]))[SMOOTHED:-SMOOTHED]


def kinematics(rehearsal, name):
    """Position, speed, acceleration and effort at the samples, smoothed."""
    i = rehearsal.parts.index(name)
    smooth = lambda x, order=0: savgol_filter(x, 7, 3, deriv=order, delta=1 / RATE_HZ)
    q = rehearsal.seen[:, i]
    return q, smooth(q, 1), smooth(q, 2), rehearsal.reported[:, i]


def size(floors, parts, share, seed):
    """Sets the floors to `share` of the effort, by motions in which nothing is hidden."""
    for floor in floors.values():
        floor.clear()
    plain = Rehearsal(parts, {}, floors, seed)
    for name, floor in floors.items():
        floor.size(share, *kinematics(plain, name))
        floor.bear(0.03 * generate.PARTS[name]["top"])
    for _ in range(4):
        sizes = {name: [] for name in parts}
        for more in range(2):
            rehearsal = Rehearsal(parts, {}, floors, seed + more)
            for i, name in enumerate(parts):
                sizes[name].append(floors[name].sizes(rehearsal.reported[:, i]))
        for name, floor in floors.items():
            floor.fit(share, averaged(sizes[name]))
            floor.bear(0.03 * generate.PARTS[name]["top"])


def averaged(sizes):
    """Of several runs, by their squares."""
    mean = lambda values: rms(np.array(values))
    parts = {name: mean([s["parts"][name] for s in sizes]) for name in sizes[0]["parts"]}
    return dict(share=mean([s["share"] for s in sizes]), effort=mean([s["effort"] for s in sizes]), parts=parts)


def where_it_acts(residual):
    """Root mean square where an effect acts: over the samples above a fifth of its height, for one that acts at a place or a time."""
    height = np.abs(residual)
    return rms(residual[height >= 0.2 * np.quantile(height, 0.99)])


def floor_effort(parts, where, floors, seed):
    """Root mean square of the floor through the same local cubic, N m or N."""
    count = len(Rehearsal(parts, {}, floors, seed).seen)
    return rms(savgol_filter(floors[where].total(count), SMOOTHED, 3)[SMOOTHED:-SMOOTHED])


def effect_effort(parts, where, hidden, seed):
    """What the hidden effect leaves in the inverse dynamics where it acts, without a floor, N m or N."""
    run = hidden[where].get("disturbance", {}).get("run", 0)
    return where_it_acts(Rehearsal(parts, hidden, {}, seed, run).residual(where))


def draw_case(obj, effects, noise, name, seed):
    """Hidden effects, floors, and the ratio of the two (None: nothing hidden)."""
    rng = np.random.default_rng(zlib.crc32(f"machine/{name}/{seed}".encode()))
    parts = OBJECTS[obj]
    where = str(rng.choice(parts))
    if any(not generate.applies_to(e, where) for e in effects):
        where = parts[0]
    # Evenly by factors.
    share = float(np.exp(rng.uniform(*np.log(SHARES))))
    floors = {}
    for part in parts:
        p = generate.PARTS[part]
        floors[part] = Floor(rng, *p["range"], inertia_at_joint(p), 1 / RATE_HZ)
        floors[part].position_step = NOISE[noise][0] * float(rng.uniform(0.5, 3.0))
        floors[part].jitter = float(rng.uniform(0.01, 0.1))
    own_seed = int(rng.integers(1 << 31))
    size(floors, parts, share, own_seed)
    for part, floor in floors.items():
        floor.effort_step = float(rng.uniform(0.002, 0.01)) * generate.PARTS[part]["top"]
    if not effects:
        return {}, floors, None, rng
    best, largest = {}, 0.0
    below = floor_effort(parts, where, floors, own_seed)
    for _ in range(DRAWS):
        hidden = {where: {e: draw(e, generate.PARTS[where], rng) for e in effects}}
        found = effect_effort(parts, where, hidden, own_seed)
        if found > largest:
            best, largest = hidden, found
        if found >= LEAST_RATIO * below:
            break
    for _ in range(3):
        if largest >= LEAST_RATIO * below or share <= SHARES[0]:
            break
        share = max(SHARES[0], 0.95 * share * largest / (LEAST_RATIO * below))
        size(floors, parts, share, own_seed)
        below = floor_effort(parts, where, floors, own_seed)
    return best, floors, largest / below, rng


def effective(hidden, floors):
    """What of the hidden numbers the reported effort shows: it differs from the joint's by the drive's error and the filter's lag."""
    seen = json.loads(json.dumps(hidden))
    for part, effects in seen.items():
        floor = floors[part]
        if "torque_gain" in effects:
            effects["torque_gain"]["g"] *= 1 + floor.gain_sign * floor.gain_error
        if "delay" in effects:
            effects["delay"]["d"] -= floor.lag_mean_s()
    return seen


def write_case(out, name, obj, effects, noise, seed, runs, duration_s):
    """As `generate.write_case`."""
    parts = OBJECTS[obj]
    hidden, floors, found, rng = draw_case(obj, effects, noise, name, seed)
    folder = out / name
    folder.mkdir(parents=True)
    (folder / "twin.urdf").write_text(generate.urdf(parts, {part: f.nominal for part, f in floors.items()}))
    sizes = {part: [] for part in parts}
    for r in range(runs + 2):
        for floor in floors.values():
            floor.start(float(rng.uniform(0.6, 1.4)))
        bag = f"run_{r}" if r < runs else f"unseen_{r - runs}"
        times, position, effort = generate.record(parts, hidden, rng, duration_s, noise, run=r, floors=floors)
        generate.write_bag(folder / bag, parts, times, position, effort)
        for part, floor in floors.items():
            sizes[part].append(floor.sizes(effort[:, parts.index(part)]))
    truth = dict(object=obj, hidden=effective(hidden, floors), drawn=hidden, noise=noise, position_sigma=NOISE[noise][0], seed=seed, ratio=found)
    truth["floor"] = {part: dict(numbers=f.numbers(), **averaged(sizes[part])) for part, f in floors.items()}
    truth["explained"] = {part: f.explained() for part, f in floors.items()}
    (out / "truth").mkdir(exist_ok=True)
    (out / "truth" / f"{name}.json").write_text(json.dumps(truth, indent=1))
