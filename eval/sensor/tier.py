"""Makes objects as a hand-held sensor records them, reconstructs each, scores them in the twin's own frame.

    python eval/sensor/tier.py --out DIR [--artitwin PATH] [--maker PATH] [--sensor "OPTIONS"] [OBJECT ...]

An OBJECT is SEED:FAMILY:PARTS; without any, the six of the table in README.md. Needs numpy and scipy (`in_frame.py`). Every object
has a folder; what is there is not made again, so a run that was stopped goes on. `--maker` makes the recordings where another
program is to be measured.
"""

import argparse
import json
import math
import statistics
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from in_frame import in_frame  # noqa: E402

OBJECTS = ["3301:cabinet:2", "3302:cabinet:3", "3303:clamshell:2", "3304:cabinet:3", "3305:lamp:3", "3306:folding_door:3"]
TYPES = {"revolute": "hinge", "prismatic": "slide", "screw": "screw"}


def ended(command, log):
    """Runs a command, keeps its output, gives its exit code."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    log.write_text(done.stdout + done.stderr)
    return done.returncode


def measure(folder, synth, args):
    """One recording and its run: what was found of what is true."""
    folder.mkdir(parents=True, exist_ok=True)
    made, run = folder / "object", folder / "runs" / "object"
    row = {"name": folder.name}
    if not made.exists() and ended([args.maker or args.artitwin, "synth", "--out", made, *synth], folder / "synth.log"):
        return row | {"failure": (folder / "synth.log").read_text().strip()}
    if not run.exists():
        box = (made / "workspace.txt").read_text().strip()
        command = [args.artitwin, "reconstruct", made, "--out", folder / "runs", "--name", "object", f"--workspace={box}"]
        if ended(command, folder / "reconstruct.log") not in (0, 3):
            return row | {"failure": (folder / "reconstruct.log").read_text().strip().splitlines()[-1]}
    truth = json.loads((made / "truth.json").read_text())
    trial, frame = in_frame(made, run, args.artitwin)
    report = json.loads((run / "report.json").read_text())
    wanted = sorted(TYPES[p["type"]] for p in truth["parts"] if p["type"] in TYPES)
    found = sorted(TYPES.get(j["type"], j["type"]) for j in report["joints"])
    stated = {j["name"]: j for j in report["joints"]}
    positions = {p["name"]: p["motion"] for p in truth["parts"] if "axis" in p}
    joints = [j for j in trial["joints"] if not j.get("missing")]
    return row | {
        "parts": len(truth["parts"]),
        "found": trial["parts_found"],
        "wanted": wanted,
        "types": found,
        "joints": [j | {"in_deviations": in_deviations(j, stated[j["joint"]], positions[j["part"]])} for j in joints],
        "seen_mm": [trial["mesh"].get(f"state{k}/whole", {}).get("seen_mm") for k in (0, 1)],
        "frame": frame,
    }


def in_deviations(joint, stated, position):
    """Errors as multiples of the standard deviations that the twin states: of the axis, of its line, of the joint's position.

    A rotation between the found and the true motion (`motion_deg`) holds the axis' error too, so positions are compared here.
    """
    pairs = {
        "axis": (joint["axis_deg"], stated["axis_std_deg"]),
        "line": (joint.get("axis_mm"), stated["origin_std_mm"]),
        "position": (abs(abs(stated["motion"]["value"]) - abs(position)), stated["motion_std"]["value"]),
    }
    return {k: error / std for k, (error, std) in pairs.items() if error is not None and std}


def listed(values, digits):
    return ", ".join(f"{v:.{digits}f}" for v in values if v is not None)


def line(row):
    """A row of the table."""
    if "failure" in row:
        return f"| {row['name']} | {row['failure']} |" + " |" * 6
    return scored(row)


def scored(row):
    """A row of the table for a twin that was scored."""
    joints = row["joints"]
    motion = [f"{j['motion_deg']:.2f} deg" if j.get("motion_deg") is not None else f"{j['motion_mm']:.1f} mm" for j in joints]
    types = "right" if row["types"] == row["wanted"] else f"{', '.join(row['types'])} ({', '.join(row['wanted'])})"
    return (
        f"| {row['name']} | {row['found']} ({row['parts']}) | {types} | {listed([j['axis_deg'] for j in joints], 2)} "
        f"| {listed([j.get('axis_mm') for j in joints], 1)} | {', '.join(motion)} | {listed(row['seen_mm'], 1)} "
        f"| {row['frame'][0]:.2f} deg, {row['frame'][1]:.1f} mm |"
    )


def errors(rows):
    """Sentences on rows: how many are right, medians and 95th percentiles of their joints' errors."""
    counted = sum(row.get("found") == row.get("parts") and "parts" in row for row in rows)
    typed = sum("parts" in row and row["types"] == row["wanted"] for row in rows)
    told = [f"number of parts right on {counted} of {len(rows)}; types on {typed}"]
    joints = [j for row in rows for j in row.get("joints", [])]
    for key, unit in (("axis_deg", "deg"), ("axis_mm", "mm"), ("motion_deg", "deg"), ("motion_mm", "mm")):
        values = sorted(j[key] for j in joints if j.get(key) is not None)
        if values:
            high = values[min(len(values) - 1, int(0.95 * len(values)))]
            told.append(f"{key}: median {statistics.median(values):.2f}, 95th percentile {high:.2f} {unit} of {len(values)}")
    return told


def table(rows):
    text = ["| object | parts (true) | types (true) | axis, deg | line, mm | motion | seen, mm | frame off |", "|---|---|---|---|---|---|---|---|"]
    text += [line(row) for row in rows]
    told, joints = errors(rows), [j for row in rows for j in row.get("joints", [])]
    for key in ("axis", "line", "position"):
        ratios = [j["in_deviations"][key] for j in joints if key in j["in_deviations"]]
        if ratios:
            rms = math.sqrt(sum(r * r for r in ratios) / len(ratios))
            told.append(f"{key}, error over stated deviation: median {statistics.median(ratios):.2f}, root mean square {rms:.2f}")
    return "\n".join([*text, "", *told, ""])


def arguments(description):
    """The options that the scripts of this folder share."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--maker", default="", help="the program that makes the recordings; default: the one that is measured")
    return parser


def options(name):
    """Options of `synth` for SEED:FAMILY:PARTS."""
    seed, family, parts = name.split(":")
    return ["--seed", seed, "--family", family, "--parts", parts]


def main():
    parser = arguments(__doc__)
    parser.add_argument("--sensor", default="--sensor handheld", help="further options of synth")
    parser.add_argument("objects", nargs="*", default=OBJECTS)
    args = parser.parse_args()
    rows = []
    for name in args.objects:
        rows.append(measure(args.out / name.replace(":", "-"), [*options(name), *args.sensor.split()], args))
        print(line(rows[-1]), flush=True)
    (args.out / "rows.json").write_text(json.dumps(rows, indent=1))
    (args.out / "table.md").write_text(table(rows))
    print(table(rows), end="")


if __name__ == "__main__":
    main()
