"""Reconstructs recordings with their poses and again with the camera tracked, and prints what each finds of the truth.

    python eval/tracking/tier.py --out DIR [--artitwin PATH] [--set KEY=VALUE] RECORDING ...

A RECORDING is a folder with `state0`, `state1`, `truth.json` and `truth/`. Needs Python 3, numpy, scipy, rosbags, and the program.
The tracked run gets nothing but the bags (`--set capture.tracking=always`): no poses, no box; masks where the bags hold them. The
run with poses gets the box of `workspace.txt` where there is one. Each run is scored in its own frame (`eval/sensor/in_frame.py`);
the tracked world is brought near the true one by the poses of both (`artitwin track`). What is in DIR is not made again.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from trajectory import frame, nearest, read_poses, true_poses

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "sensor"))
from in_frame import in_frame  # noqa: E402
from tier import TYPES, ended, listed  # noqa: E402

TRACKED = ["--set", "capture.tracking=always"]


def start(recording, folder, args):
    """Where the truth lies in the tracked world: twin from truth."""
    poses = folder / "poses.txt"
    if not poses.exists():
        ended([args.artitwin, "track", recording / "state0", recording / "state1", *args.options], poses)
    found = read_poses("\n".join(line for line in poses.read_text().splitlines() if line[:1] in "#-0123456789"))[0]
    truth = true_poses(recording, 0)
    return np.linalg.inv(frame(nearest(found, truth), truth))


def measure(recording, folder, tracked, args):
    """What one run finds, or why it finds nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    run, log = folder / "object", folder / "reconstruct.log"
    if not log.exists():
        box = recording / "workspace.txt"
        options = TRACKED if tracked else [f"--workspace={box.read_text().strip()}"] if box.exists() else []
        command = [args.artitwin, "reconstruct", recording / "state0", recording / "state1", "--out", folder, "--name", "object"]
        ended([*command, *options, *args.options], log)
    if not run.exists():
        return {"failure": next((x for x in log.read_text().splitlines() if x.startswith("error")), "no twin")[:150]}
    truth = json.loads((recording / "truth.json").read_text())
    report = json.loads((run / "report.json").read_text())
    trial, off = in_frame(recording, run, args.artitwin, start(recording, folder, args) if tracked else None)
    return {
        "parts": len(truth["parts"]),
        "found": trial["parts_found"],
        "wanted": sorted(TYPES[p["type"]] for p in truth["parts"] if p["type"] in TYPES),
        "types": sorted(TYPES.get(j["type"], j["type"]) for j in report["joints"]),
        "joints": [j for j in trial["joints"] if not j.get("missing")],
        "seen_mm": [trial["mesh"].get(f"state{k}/whole", {}).get("seen_mm") for k in (0, 1)],
        "off": off,
    }


def line(name, how, row):
    """A row of the table."""
    if "failure" in row:
        return f"| {name} | {how} | {row['failure']} |"
    joints = row["joints"]
    motion = [f"{j['motion_deg']:.2f} deg" if j.get("motion_deg") is not None else f"{j['motion_mm']:.1f} mm" for j in joints]
    types = "right" if row["types"] == row["wanted"] else f"{', '.join(row['types'])} ({', '.join(row['wanted'])})"
    return (
        f"| {name} | {how} | {row['found']} ({row['parts']}) | {types} | {listed([j['axis_deg'] for j in joints], 2)} "
        f"| {listed([j.get('axis_mm') for j in joints], 1)} | {', '.join(motion)} | {listed(row['seen_mm'], 1)} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--only-tracked", action="store_true")
    parser.add_argument("recordings", nargs="+", type=Path)
    args = parser.parse_args()
    args.options = [o for s in args.set for o in ("--set", s)]
    print("| recording | poses | parts (true) | types (true) | axis, deg | line, mm | motion | seen, mm |", flush=True)
    print("|---|---|---|---|---|---|---|---|")
    for recording in args.recordings:
        name = "-".join(recording.resolve().parts[-2:])
        for tracked in (False, True)[args.only_tracked :]:
            how = "tracked" if tracked else "recorded"
            print(line(name, how, measure(recording, args.out / name / how, tracked, args)), flush=True)


if __name__ == "__main__":
    main()
