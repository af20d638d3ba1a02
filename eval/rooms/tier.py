"""Makes rooms as an active stereo camera records them, reconstructs each with default settings, and scores the twins.

    python eval/rooms/tier.py --out DIR [--artitwin PATH] [--maker PATH] [--count N] [--seed BASE] [SCENE ...]

A SCENE is SEED:FAMILY:PARTS:POSES; without any, N of them (30): families mixed, poses of a robot, of a SLAM and none in turn, seeds
from BASE on. `reconstruct` gets the bags and nothing else: no box, no masks. Each twin is scored in its own frame
(`eval/sensor/in_frame.py`); where no poses were recorded, the tracked world is brought near the true one first, by the poses that
`artitwin track` finds. Needs numpy, scipy and rosbags. What is in DIR is not made again, so a run that was stopped goes on.
"""

import json
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

EVAL = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(EVAL / "sensor"), str(EVAL / "tracking")]
from in_frame import in_frame  # noqa: E402
from tier import TYPES, arguments, ended, errors, scored  # noqa: E402
from trajectory import frame, nearest, read_poses, true_poses  # noqa: E402

POSES = ["robot", "slam", "none"]
FAMILIES = ["cabinet:2", "clamshell:2", "cabinet:3", "lamp:3", "cabinet:2", "folding_door:3", "cabinet:4", "capped_box:2"]
# Views of a state; a camera without poses is tracked from view to view.
VIEWS = {"robot": 30, "slam": 30, "none": 60}


def scenes(count, base):
    """SEED:FAMILY:PARTS:POSES of every scene."""
    return [f"{base + k}:{FAMILIES[k // len(POSES) % len(FAMILIES)]}:{POSES[k % len(POSES)]}" for k in range(count)]


def made_with(name):
    """Options of `synth` for a scene."""
    seed, family, parts, poses = name.split(":")
    options = ["--seed", seed, "--family", family, "--parts", parts, "--poses", poses, "--views", str(VIEWS[poses])]
    return [*options, "--depth", "stereo", "--room"]


def start(made, folder, args):
    """Where the truth lies in the tracked world: twin from truth."""
    poses = folder / "poses.txt"
    if not poses.exists():
        ended([args.artitwin, "track", made / "state0", made / "state1"], poses)
    found = read_poses("\n".join(line for line in poses.read_text().splitlines() if line[:1] in "#-0123456789"))[0]
    truth = true_poses(made, 0)
    return np.linalg.inv(frame(nearest(found, truth), truth))


def reconstructed(made, folder, args):
    """Exit code and seconds of `reconstruct`."""
    kept = folder / "ended.json"
    if not kept.exists():
        began = time.monotonic()
        code = ended([args.artitwin, "reconstruct", made, "--out", folder / "runs", "--name", "object"], folder / "reconstruct.log")
        kept.write_text(json.dumps({"exit": code, "seconds": time.monotonic() - began}))
    return json.loads(kept.read_text())


def measure(folder, name, args):
    """One scene and its run: what was found of what is true."""
    folder.mkdir(parents=True, exist_ok=True)
    made, run = folder / "object", folder / "runs" / "object"
    row = {"name": name}
    if not made.exists() and ended([args.maker or args.artitwin, "synth", "--out", made, *made_with(name)], folder / "synth.log"):
        return row | {"failure": (folder / "synth.log").read_text().strip()[:150]}
    row |= reconstructed(made, folder, args)
    if not run.exists():
        lines = (folder / "reconstruct.log").read_text().splitlines()
        return row | {"failure": next((x for x in lines if x.startswith("error")), "no twin")[:150]}
    truth = json.loads((made / "truth.json").read_text())
    report = json.loads((run / "report.json").read_text())
    row |= {
        "parts": len(truth["parts"]),
        "wanted": sorted(TYPES[p["type"]] for p in truth["parts"] if p["type"] in TYPES),
        "types": sorted(TYPES.get(j["type"], j["type"]) for j in report["joints"]),
        "word": report["overall"]["word"],
    }
    try:
        trial, off = in_frame(made, run, args.artitwin, start(made, folder, args) if name.endswith("none") else None)
    except (RuntimeError, ValueError, IndexError) as error:
        return row | {"failure": f"not scored: {error}"[:150]}
    return row | {
        "found": trial["parts_found"],
        "joints": [j for j in trial["joints"] if not j.get("missing")],
        "seen_mm": [trial["mesh"].get(f"state{k}/whole", {}).get("seen_mm") for k in (0, 1)],
        "frame": off,
    }


def line(row):
    """A row of the table."""
    if "joints" not in row:
        word, code = row.get("word", ""), row.get("exit", "")
        return f"| {row['name']} | {row['failure']} |" + " |" * 6 + f" {word} | {code} | {row.get('seconds', 0):.0f} |"
    return f"{scored(row)} {row['word']} | {row['exit']} | {row['seconds']:.0f} |"


def is_right(row):
    """Whether a twin has all parts and types, axes within 1 deg and 10 mm, and motions within 1 deg or 5 mm."""
    limits = {"axis_deg": 1, "axis_mm": 10, "motion_deg": 1, "motion_mm": 5}
    errors = [(j[key], limit) for j in row["joints"] for key, limit in limits.items() if j.get(key) is not None]
    return row["found"] == row["parts"] and row["types"] == row["wanted"] and all(e <= limit for e, limit in errors)


def verdicts(rows):
    """What the report's word was on right and on wrong twins."""
    some = [row for row in rows if "joints" in row]
    counts = {right: Counter(row["word"] for row in some if is_right(row) == right) for right in (True, False)}
    sentences = []
    for right, words in counts.items():
        told = ", ".join(f"{word} {count}" for word, count in sorted(words.items())) or "none"
        sentences.append(f"{'right' if right else 'wrong'} twins by the report's word: {told}")
    return sentences


def table(rows):
    """All rows, and what they say together, by who reports the poses."""
    text = [
        "| scene | parts (true) | types (true) | axis, deg | line, mm | motion | seen, mm | frame off | word | exit | s |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *map(line, rows),
        "",
    ]
    for poses in POSES:
        some = [row for row in rows if row["name"].endswith(poses)]
        if some:
            text += [f"poses {poses}:", *(f"- {sentence}" for sentence in errors(some)), ""]
    text += [f"- {sentence}" for sentence in verdicts(rows)] + [""]
    return "\n".join(text)


def main():
    parser = arguments(__doc__)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=8200)
    parser.add_argument("scenes", nargs="*")
    args = parser.parse_args()
    rows = []
    for name in args.scenes or scenes(args.count, args.seed):
        rows.append(measure(args.out / name.replace(":", "-"), name, args))
        print(line(rows[-1]), flush=True)
        (args.out / "rows.json").write_text(json.dumps(rows, indent=1))
        (args.out / "table.md").write_text(table(rows))
    print(table(rows), end="")


if __name__ == "__main__":
    main()
