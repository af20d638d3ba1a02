"""Makes random objects, reconstructs each, scores them into one table.

    python eval/random_objects.py --out DIR [--artitwin PATH] [--seeds 0:60] [--preset NAME] [--give-parts]
        [--synth "OPTIONS"] [--reconstruct "OPTIONS"]

Needs Python 3 and the program. Every seed has a folder DIR/<seed> with the object, the run and their logs; what is there is
not made again, so a run that was stopped goes on. The table is printed and written to DIR/table.md, the rows to DIR/rows.json.
An object counts as right when its number of parts is right. A failure is an object with a wrong number of parts, a wrong
joint type, an axis off by more than 1 degree or a line by more than 10 mm, or no result; each is listed with what the program printed last.
"""

import argparse
import json
import shlex
import statistics
import subprocess
from pathlib import Path

AXIS_LIMIT_DEG = 1.0
LINE_LIMIT_MM = 10.0


def program(command, log):
    """Runs a command, keeps its output, gives its exit code and its last line."""
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    log.write_text(ended.stdout + ended.stderr)
    lines = [line for line in ended.stderr.splitlines() if line.strip()]
    return ended.returncode, lines[-1] if lines else ""


def score(seed, args):
    """One row: what was made, what was found, and why it failed."""
    folder = args.out / str(seed)
    folder.mkdir(parents=True, exist_ok=True)
    made, run = folder / "object", folder / "runs" / "object"
    if not made.exists():
        code, said = program([args.artitwin, "synth", "--out", made, "--seed", str(seed), *shlex.split(args.synth)], folder / "synth.log")
        if code:
            return {"seed": seed, "failure": f"synth: {said}"}
    truth = json.loads((made / "truth.json").read_text())
    parts = len(truth["parts"])
    row = {"seed": seed, "family": truth["family"], "parts": parts}
    if not run.exists():
        command = [args.artitwin, "reconstruct", made, "--out", folder / "runs", "--preset", args.preset, *shlex.split(args.reconstruct)]
        command += ["--parts", str(parts)] if args.give_parts else []
        code, said = program(command, folder / "reconstruct.log")
        if code not in (0, 3):
            return row | {"failure": f"reconstruct: {said}"}
    ended = subprocess.run([args.artitwin, "evaluate", run, "--truth", made, "--json"], capture_output=True, text=True, check=False)
    if ended.returncode:
        return row | {"failure": f"evaluate: {ended.stderr.strip()}"}
    trial = json.loads(ended.stdout)["trials"][0]
    row |= {"found": trial["parts_found"], "joints": trial["joints"]}
    by_name = {p["name"]: p for p in truth["parts"]}
    wrong = []
    if row["found"] != parts:
        wrong.append(f"{row['found']} parts of {parts}")
    for joint in trial["joints"]:
        part = by_name[joint["part"]]
        name = f"{joint['part']} ({joint['type_true']}, motion {part['motion']:.3f}, seen points {part['seen_points']})"
        if joint.get("missing"):
            wrong.append(f"{name} missing")
        elif not joint["type_right"]:
            wrong.append(f"{name} found as {joint['type']}")
        elif joint["axis_deg"] > AXIS_LIMIT_DEG:
            wrong.append(f"{name} axis off by {joint['axis_deg']:.1f} deg")
        elif joint.get("axis_mm", 0) > LINE_LIMIT_MM:
            wrong.append(f"{name} line off by {joint['axis_mm']:.0f} mm")
    return row | ({"failure": "; ".join(wrong)} if wrong else {})


def percentile(values, share):
    """The value below which that share lies."""
    ordered = sorted(values)
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)] if ordered else float("nan")


def table(rows):
    """Objects one a line, then the sums and the failures."""
    text = ["| seed | family | parts | found | joints right | worst axis, deg | worst line, mm |", "|---|---|---|---|---|---|---|"]
    axes, right, joints = [], 0, 0
    for row in rows:
        found = [j for j in row.get("joints", []) if not j.get("missing")]
        ok = [j for j in found if j["type_right"]]
        joints, right = joints + len(found), right + len(ok)
        axes += [j["axis_deg"] for j in ok]
        worst = max((j["axis_deg"] for j in ok), default=float("nan"))
        line = max((j["axis_mm"] for j in ok if j.get("axis_mm") is not None), default=float("nan"))
        text.append(
            f"| {row['seed']} | {row.get('family', '')} | {row.get('parts', '')} | {row.get('found', 'none')} "
            f"| {len(ok)} of {len(row.get('joints', []))} | {worst:.2f} | {line:.1f} |"
        )
    counted = sum(row.get("found") == row.get("parts") and "parts" in row for row in rows)
    median = statistics.median(axes) if axes else float("nan")
    text += [
        "",
        f"part count right: {counted} of {len(rows)}; joint type right: {right} of {joints} found joints; "
        f"axis: median {median:.2f} deg, 95th percentile {percentile(axes, 0.95):.2f} deg",
    ]
    text += [f"- seed {row['seed']}: {row['failure']}" for row in rows if "failure" in row]
    return "\n".join(text) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--seeds", default="0:60", help="FIRST:END")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--give-parts", action="store_true", help="pass the true number of parts")
    parser.add_argument("--synth", default="", help="further options of synth")
    parser.add_argument("--reconstruct", default="", help="further options of reconstruct")
    args = parser.parse_args()
    first, end = (int(n) for n in args.seeds.split(":"))
    rows = []
    for seed in range(first, end):
        rows.append(score(seed, args))
        print(f"seed {seed}: {rows[-1].get('failure', 'right')}", flush=True)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "rows.json").write_text(json.dumps(rows, indent=1))
    (args.out / "table.md").write_text(table(rows))
    print(table(rows), end="")


if __name__ == "__main__":
    main()
