"""The table of a suite's results.

usage: table.py WORK/results [TITLE [COMMAND]]
"""

import datetime
import json
import math
import sys
from pathlib import Path


# Other simulators than MuJoCo, by their kind.
SIMULATORS = {"bullet": "PyBullet", "drake": "Drake"}


def bounds(k, n):
    """Wilson's 95 % interval of a share, in per cent."""
    if n == 0:
        return 0.0, 100.0
    z, p = 1.96, k / n
    middle, half = (p + z * z / (2 * n)) / (1 + z * z / n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return 100 * (middle - half), 100 * (middle + half)


def row(label, k, n):
    low, high = bounds(k, n)
    return f"| {label} | {k} | {n} | {100 * k / max(n, 1):.1f} | {low:.0f} to {high:.0f} |"


def share(values, at):
    values = sorted(values)
    return values[min(len(values) - 1, int(at * len(values)))] if values else math.nan


def table(folder, title, command):
    results = [json.loads(f.read_text()) for f in sorted(Path(folder).glob("*.json"))]
    of = lambda **want: [r for r in results if all(r[k] == v for k, v in want.items())]
    right = lambda some: sum(r["result"] == "right" for r in some)
    lines = [f"Blind suite of {datetime.date.today().isoformat()}: {title}; {len(results)} done. Written by `{command}`.", ""]
    lines += ["| demand | cases that meet it | cases | % | 95 % interval |", "|---|---|---|---|---|"]
    single, null, pair, outside = (of(kind=k) for k in ("single", "null", "pair", "outside"))
    if single:
        lines.append(row("one hidden effect: right name", right(single), len(single)))
    if null:
        lines.append(row("nothing hidden: no name", right(null), len(null)))
        lines.append(row("nothing hidden: verdict `none`", sum(r["verdict"] == "none" for r in null), len(null)))
    if pair:
        lines.append(row("two hidden effects: both names right", right(pair), len(pair)))
    found = [r for r in single + pair if r.get("findings")]
    if found:
        lines.append(row("which joint", sum(r["result"] != "wrong joint" for r in found), len(found)))
    if outside:
        lines.append(row("outside the library: `unknown`", right(outside), len(outside)))
        lines.append(row("outside the library: `unknown`, variable and region right", sum(r["result"] == "right" and r["place"] for r in outside), len(outside)))
        lines.append(row("outside the library: no confident wrong name", sum(r["verdict"] != "named" for r in outside), len(outside)))
    covered = [c for r in single if r["result"] == "right" for c in r["covered"]]
    if covered:
        lines.append(row("95 % intervals that hold the truth", sum(c["inside"] for c in covered), len(covered)))
    lines += machine_rows(of(kind="machine"), of(kind="machine_null"))
    lines += servo_rows(of(kind="servo"), of(kind="servo_null"))
    for kind, simulator in SIMULATORS.items():
        lines += simulator_rows(simulator, of(kind=kind), of(kind=f"{kind}_null"))
    lines += ["", "| one effect, by | right | cases | % | 95 % interval |", "|---|---|---|---|---|"]
    for noise in ("low", "mid", "high"):
        some = [r for r in single if r["noise"] == noise]
        lines += [row(f"noise {noise}", right(some), len(some))] if some else []
    for obj in sorted({r["object"] for r in single}):
        some = [r for r in single if r["object"] == obj]
        lines.append(row(obj, right(some), len(some)))
    others = [(f"{kind}: ", of(kind=kind)) for kind in ("machine", "servo", *SIMULATORS)]
    for kind, some_kind in (("", single), ("outside: ", outside), *others):
        for effect in sorted({r["effects"][0] for r in some_kind}):
            some = [r for r in some_kind if r["effects"] == [effect]]
            lines.append(row(kind + effect, right(some), len(some)))
    lines += ["", *figures(results)]
    wrong = [r for r in results if r["result"] != "right"]
    if wrong:
        lines += ["", "Cases that were not right:", ""]
        name = lambda r: " + ".join(f"{f['effect']} (weight {f['weight']:.2f})" for f in r.get("findings", [])) or "no name"
        lines += [f"- {r['kind']} `{r['name']}`: {r['result']}, verdict {r['verdict']}, {name(r)}" for r in wrong]
    return "\n".join(lines) + "\n"


def servo_rows(servo, null):
    """Demands on joints under a servo of unknown gains."""
    lines = []
    if servo:
        lines.append(row("servo, one hidden effect: right name", sum(r["result"] == "right" for r in servo), len(servo)))
    if null:
        lines.append(row("servo, nothing hidden: no name", sum(r["result"] == "right" for r in null), len(null)))
    return lines


def simulator_rows(simulator, single, null):
    """Demands on recordings of another simulator than MuJoCo."""
    lines = []
    if single:
        lines.append(row(f"{simulator}, one hidden effect: right name", sum(r["result"] == "right" for r in single), len(single)))
    if null:
        lines.append(row(f"{simulator}, nothing hidden: no name", sum(r["result"] == "right" for r in null), len(null)))
    covered = [c for r in single if r["result"] == "right" for c in r["covered"]]
    if covered:
        lines.append(row(f"{simulator}: 95 % intervals that hold the truth", sum(c["inside"] for c in covered), len(covered)))
    return lines


def machine_rows(machine, null):
    """Demands on machines, whose floor is no effect."""
    lines = []
    if machine:
        lines.append(row("machine, one hidden effect: right first name", sum(r.get("first", False) for r in machine), len(machine)))
        held = lambda r: any(e in r["effects"] for f in r.get("findings", []) for e in [f["effect"], *(a["effect"] for a in f["alternatives"])])
        lines.append(row("machine, one hidden effect: right name among names and alternatives", sum(held(r) for r in machine), len(machine)))
        lines.append(row("machine, one hidden effect: no other name, alternatives counted", sum(r["result"] == "right" for r in machine), len(machine)))
    if null:
        lines.append(row("machine, nothing hidden: a name (at most 3 %)", sum(r["result"] == "false name" for r in null), len(null)))
        lines.append(row("machine, nothing hidden: verdict `none`", sum(r["verdict"] == "none" for r in null), len(null)))
    covered = [c for r in machine if r["result"] == "right" for c in r["covered"]]
    if covered:
        lines.append(row("machine: 95 % intervals that hold the truth", sum(c["inside"] for c in covered), len(covered)))
    judged = [r for r in machine + null if "worse" in r]
    if judged:
        lines.append(row("machine: exported MJCF worse than the twin at a joint", sum(r["worse"] for r in judged), len(judged)))
    return lines


def machine_figures(machine):
    """The exported MJCF over the twin, floors, and what is hidden over them."""
    ratios = [r["mjcf_ratio"] for r in machine if "mjcf_ratio" in r]
    if not ratios:
        return []
    shares = [f["share"] for r in machine if "floor" in r for f in r["floor"].values()]
    above = [r["ratio"] for r in machine if r.get("ratio")]
    return [
        f"Machines, exported MJCF over the twin on {len(ratios)} machines' unseen runs, start states fitted: median {share(ratios, 0.5):.3f}, highest {max(ratios):.3f}.",
        f"Floors: {100 * min(shares):.0f} to {100 * max(shares):.0f} % of the effort, median {100 * share(shares, 0.5):.1f} %; "
        f"hidden effect over floor: median {share(above, 0.5):.1f}, lowest {min(above):.1f}.",
    ]


def figures(results):
    """Gap and time."""
    named = [r for r in results if r["kind"] in ("single", "pair") and r["verdict"] in ("named", "ambiguous") and r["effects"] != ["disturbance"]]
    gaps = [r["gap"] for r in named if r["gap"]["before"] and r["gap"]["before"] > 1.5 * r["gap"]["noise_floor"]]
    left = [(g["after"] - g["noise_floor"]) / (g["before"] - g["noise_floor"]) for g in gaps]
    times = [r["cpu_s"] / r["joints"] * 50.0 / max(r["fitted_s"], 1.0) for r in results if r["result"] != "failed"]
    lines = []
    if left:
        lines.append(f"Gap left on held-out runs, (after - floor) / (before - floor), {len(left)} named cases: median {share(left, 0.5):.3f}, 95th percentile {share(left, 0.95):.3f}.")
    replays = [r["replay"] for r in results if "replay" in r]
    if replays:
        near = sum(abs(x - 1) < 0.03 for x in replays)
        lines.append(f"Exported MJCF rolled out by MuJoCo over `after`, {len(replays)} cases whose effects are native: within 3 % in {near}, median {share(replays, 0.5):.3f}, highest {max(replays):.3f}.")
    beside = [r["replay_with_effects"] for r in results if "replay_with_effects" in r]
    if beside:
        near = sum(x <= 1.2 for x in beside)
        lines.append(f"The same with the effects beside a file that cannot hold them (docs/effects.md), {len(beside)} cases: at most 1.2 in {near}, median {share(beside, 0.5):.3f}, highest {max(beside):.3f}.")
    stiffness = [abs(r["stiffness"] - 1) for r in results if "stiffness" in r]
    if stiffness:
        lines.append(f"Stiffness of {len(stiffness)} servos, off by: median {share(stiffness, 0.5):.4f}, highest {max(stiffness):.4f}.")
    lines += machine_figures([r for r in results if r["kind"] == "machine"])
    if times:
        lines.append(f"CPU per joint and 50 s of fitted log: median {share(times, 0.5):.1f} s, 95th percentile {share(times, 0.95):.1f} s.")
    return lines


if __name__ == "__main__":
    given = sys.argv[2:]
    print(table(sys.argv[1], given[0] if given else "so far", given[1] if len(given) > 1 else "eval/gap/table.py"))
