"""The blind suite as one command: makes every case, diagnoses it, judges it, deletes its bags, and writes the table.

A run that was stopped goes on where it was; results stay in WORK/results, one file a case.

`tests/gap_suite.rs` runs the size `ci`, every effect once, and holds what it counts.

usage: suite.py PROGRAM WORK [--size ci|day|full] [--seed N] [--jobs N] [--table FILE] [--only KIND ...] [--written-by COMMAND]
"""

import argparse
import json
import math
import multiprocessing
import os
import random
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).resolve().parents[2] / "tests/python/gap")]
import generate
import mjcf_error
import replay
import score
from table import table

# kind: (noises, runs, seconds of a run, cases).
SIZES = {
    "ci": {
        "single": (["mid"], 3, 8.0, 22),
        "null": (["mid"], 3, 8.0, 4),
        "pair": (["mid"], 4, 8.0, 4),
        "outside": (["mid"], 4, 8.0, 6),
        "machine": (["mid"], 3, 8.0, 4),
        "machine_null": (["mid"], 3, 8.0, 3),
        "servo": (["mid"], 3, 12.0, 5),
        "servo_null": (["mid"], 3, 12.0, 3),
        "bullet": (["mid"], 3, 8.0, 12),
        "bullet_null": (["mid"], 3, 8.0, 2),
        "drake": (["mid"], 3, 8.0, 5),
        "drake_null": (["mid"], 3, 8.0, 1),
    },
    "day": {
        "single": (["low", "mid", "high"], 5, 10.0, 132),
        "null": (["low", "mid", "high"], 3, 8.0, 84),
        "pair": (["low", "mid", "high"], 5, 10.0, 48),
        "outside": (["low", "mid", "high"], 5, 10.0, 48),
        "machine": (["low", "mid"], 5, 10.0, 132),
        "machine_null": (["low", "mid"], 3, 8.0, 84),
        "servo": (["low", "mid", "high"], 3, 12.0, 45),
        "servo_null": (["low", "mid", "high"], 3, 12.0, 18),
        "bullet": (["low", "mid", "high"], 5, 10.0, 72),
        "bullet_null": (["low", "mid", "high"], 3, 8.0, 24),
        "drake": (["low", "mid", "high"], 5, 10.0, 30),
        "drake_null": (["low", "mid", "high"], 3, 8.0, 12),
    },
    "full": {
        "single": (["low", "mid", "high"], 5, 10.0, 1100),
        "null": (["low", "mid", "high"], 3, 8.0, 300),
        "pair": (["low", "mid", "high"], 5, 10.0, 60),
        "outside": (["low", "mid", "high"], 5, 10.0, 90),
        "machine": (["low", "mid"], 5, 10.0, 440),
        "machine_null": (["low", "mid"], 3, 8.0, 300),
        "servo": (["low", "mid", "high"], 3, 12.0, 150),
        "servo_null": (["low", "mid", "high"], 3, 12.0, 90),
        "bullet": (["low", "mid", "high"], 5, 10.0, 240),
        "bullet_null": (["low", "mid", "high"], 3, 8.0, 90),
        "drake": (["low", "mid", "high"], 5, 10.0, 100),
        "drake_null": (["low", "mid", "high"], 3, 8.0, 60),
    },
}


def plan(kind, setting, seed):
    """The cases of a kind in an order drawn from the seed: every family once a turn, its objects and the noises by turns, so
    that a suite that is cut short has met families, objects and noises alike."""
    noises, runs, duration, wanted = setting
    draw = random.Random(f"{kind}/{seed}")
    families = {}
    for obj, effects, _, _ in generate.cases(kind, list(generate.OBJECTS), [], ["mid"], [seed]):
        families.setdefault(effects, []).append((obj, effects))
    if kind.endswith("null"):
        families = {obj: [(obj, effects)] for (obj, effects) in families[()]}
    cells = {}
    for family, members in families.items():
        # Every object with every noise, noises changing fastest over a shuffled start.
        draw.shuffle(members)
        levels = draw.sample(noises, len(noises))
        count = math.lcm(len(members), len(levels))
        blocks = range(len(members) * len(levels) // count)
        cells[family] = [(*members[i % len(members)], levels[(i + block) % len(levels)]) for block in blocks for i in range(count)]
    cases, turn = [], 0
    while len(cases) < wanted:
        for family in draw.sample(sorted(families), len(families)):
            own = cells[family]
            obj, effects, noise = own[turn % len(own)]
            cases.append((kind, obj, effects, noise, seed + turn // len(own), runs, duration))
        turn += 1
    return cases[:wanted]


def judge_machine(record, truth, report, out, case):
    """Adds what is judged of machines alone: names, and the exported MJCF on runs that the program did not get."""
    named = score.without_floor(truth, report)
    record |= dict(result=score.judge(truth, named), first=score.first_name(truth, named), of_floor=len(report["findings"]) - len(named["findings"]))
    record |= {key: truth[key] for key in ("drawn", "ratio", "floor", "explained")}
    found = mjcf_error.errors(case / "twin.urdf", out / "twin.xml", sorted(case.glob("unseen_*")))
    record["mjcf"] = found
    record["mjcf_ratio"] = found[next((f"{part}_joint" for part in truth["hidden"]), "all")][2]
    record["worse"] = any(ratio > mjcf_error.WORSE for _, _, ratio in found.values())


def one(job):
    """Makes, diagnoses and judges one case."""
    program, work, (kind, obj, effects, noise, seed, runs, duration) = job
    name = "_".join([obj, *(effects or ["nothing"]), noise, str(seed)])
    result = work / "results" / f"{kind}-{name}.json"
    if result.exists():
        return None
    folder = work / f"case-{kind}-{name}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    is_machine = kind.startswith("machine")
    generate.writer(kind)(folder, name, obj, effects, noise, seed, runs, duration)
    case, out = folder / name, folder / "out"
    started, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    command = [program, "diagnose", case / "twin.urdf", *(case / f"run_{r}" for r in range(runs)), "--out", out]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    cpu = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    truth = json.loads((folder / "truth" / f"{name}.json").read_text())
    record = dict(kind=kind, name=name, effects=list(effects), object=obj, noise=noise, seed=seed, cpu_s=cpu, wall_s=time.monotonic() - started)
    record |= dict(joints=len(generate.OBJECTS[obj]), fitted_s=(runs - max(1, runs // 3)) * duration, truth=truth["hidden"])
    report = json.loads((out / "report.json").read_text()) if (out / "report.json").exists() else {"verdict": "failed"}
    # Exit code 3 means that the runs say too little, or that a file keeps the twin's values.
    if report["verdict"] in ("failed", "insufficient"):
        record |= dict(result="failed", verdict="failed", error=done.stderr[-500:])
    else:
        record |= dict(result=score.judge(truth, report), verdict=report["verdict"], where=report["where"][:6])
        record |= dict(findings=report["findings"], gap={k: report["gap"][k] for k in ("before", "after", "noise_floor")})
        record["place"] = score.place(truth, report)
        record["covered"] = score.coverage(truth, report)
        found = [p["value"] for a in report["actuators"] for p in a["parameters"] if p["name"] == "stiffness"]
        if found and "stiffness" in truth:
            record["stiffness"] = found[0] / truth["stiffness"]
        named = {f["joint"] for f in report["findings"]}
        mjcf = [e for e in report["exports"] if e["format"] == "mjcf"]
        if is_machine:
            judge_machine(record, truth, report, out, case)
        elif not kind.startswith("servo") and len(named) == 1:
            joint = named.pop()
            own = [r["after"] ** 2 for r in report["gap"]["runs"] if r["joint"] == joint]
            # What the file cannot hold runs beside it.
            key = "replay" if all(e["status"] == "native" for e in mjcf) else "replay_with_effects"
            record[key] = replay.replay(out, [case / f"run_{r}" for r in range(runs)])[joint] / (sum(own) / len(own)) ** 0.5
    result.parent.mkdir(exist_ok=True)
    part = result.with_suffix(".part")
    part.write_text(json.dumps(record))
    part.rename(result)
    shutil.rmtree(folder)
    return f"{kind} {name}: {record['result']}, {cpu:.1f} s"


def main():
    a = argparse.ArgumentParser(description=__doc__)
    a.add_argument("program", type=Path)
    a.add_argument("work", type=Path)
    a.add_argument("--size", choices=list(SIZES), default="day")
    a.add_argument("--seed", type=int, default=5000)
    a.add_argument("--jobs", type=int, default=2)
    a.add_argument("--table", type=Path)
    a.add_argument("--only", nargs="*", default=[])
    a.add_argument("--written-by", help="of the page: the command that a reader repeats")
    o = a.parse_args()
    os.environ["RAYON_NUM_THREADS"] = "1"
    kinds = {k: v for k, v in SIZES[o.size].items() if not o.only or k in o.only}
    plans = [plan(kind, setting, o.seed) for kind, setting in kinds.items()]
    # The kinds by turns, so that a suite that is stopped early has something of each.
    longest = max(len(p) for p in plans)
    jobs = [p[i * len(p) // longest] for i in range(longest) for p in plans if i == 0 or i * len(p) // longest != (i - 1) * len(p) // longest]
    with multiprocessing.Pool(o.jobs) as pool:
        for line in pool.imap_unordered(one, [(o.program, o.work, j) for j in jobs]):
            if line:
                print(line, flush=True)
    again = o.written_by or " ".join(["python eval/gap/suite.py PROGRAM WORK --size", o.size, "--seed", str(o.seed), *(["--only", *o.only] if o.only else [])])
    text = table(o.work / "results", f"size {o.size}, seeds from {o.seed}, {len(jobs)} cases planned", again)
    print(text)
    if o.table:
        o.table.write_text(text)


if __name__ == "__main__":
    main()
