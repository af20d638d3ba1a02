"""Is the right thing taken for the object, without masks and without a box? Scenes with clutter, filmed by hand, and other recordings.

    python eval/tracking/objects.py --out DIR [--artitwin PATH] [--seeds FROM:TO] [--synth "OPTIONS"] [RECORDING ...]

Makes scenes (`synth --sensor handheld`), or takes RECORDINGs (folders with `state0`, `state1` and `truth/`), looks with `artitwin
inspect --picture`, and compares the box of what was taken for the object with that of the true points that the views saw. A scene is
right if every face of the box lies within three cells, or 3 % of the box' diagonal, of the true one; a refusal that asks which of
several things is meant counts as asked. Needs Python 3, numpy and the program. Pictures and texts stay in DIR.
"""

import argparse
import re
import subprocess
from pathlib import Path

import numpy as np

NUMBERS = r"\(([-\d.]+), ([-\d.]+), ([-\d.]+)\)"


def true_box(recording):
    """Box of the object's points that the views of any state saw."""
    points = np.vstack([np.load(f)[:, :3] for f in sorted(recording.glob("truth/state*/seen.npy"))])
    return np.array([points.min(0), points.max(0)])


def look(recording, folder, args):
    """One scene: right, asked or wrong; and in figures how."""
    picture, text = folder / f"{recording.name}.png", folder / f"{recording.name}.txt"
    if not text.exists():
        picture.unlink(missing_ok=True)
        options = ["--set", "capture.isolate.use_masks=false"]
        done = subprocess.run(
            [args.artitwin, "inspect", recording, "--picture", picture, *options], capture_output=True, text=True, check=False)
        text.write_text(done.stdout + done.stderr)
    told = text.read_text()
    if "changed between the states, about" in told:
        return "asked", re.search(r"\d+ things changed[^;]*", told).group(0)
    found = re.search(rf"object isolated as .*?; \d+ of \d+ cells of ([\d.]+) mm, in the box {NUMBERS} to {NUMBERS}", told, re.DOTALL)
    if not found:
        return "refused", told.strip().splitlines()[-1][:160]
    numbers = [float(x) for x in found.groups()]
    box, cell_m = np.array(numbers[1:]).reshape(2, 3), 1e-3 * numbers[0]
    truth = true_box(recording)
    off = (box - truth) * [[-1], [1]]
    worst = max(off.min(), off.max(), key=abs)
    reach = max(3 * cell_m, 0.03 * np.linalg.norm(truth[1] - truth[0]))
    why = re.search(r"groups of points, ([^;]*?)[;)]", told).group(1)
    return ("right" if abs(worst) <= reach else "wrong"), f"{1e3 * worst:+.0f} mm (at most {1e3 * reach:.0f}); {why}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--maker", default="")
    parser.add_argument("--seeds", default="")
    parser.add_argument("--synth", default="--sensor handheld")
    parser.add_argument("recordings", nargs="*", type=Path)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    recordings = list(args.recordings)
    if args.seeds:
        first, last = map(int, args.seeds.split(":"))
        recordings += [args.out / f"scene_{seed}" for seed in range(first, last)]
    counts = {}
    for recording in recordings:
        if not recording.exists():
            seed = recording.name.split("_")[1]
            subprocess.run(
                [args.maker or args.artitwin, "synth", "--out", recording, "--seed", seed, *args.synth.split()],
                capture_output=True, check=True)
        result, how = look(recording, args.out, args)
        counts[result] = counts.get(result, 0) + 1
        print(f"| {recording.name} | {result} | {how} |", flush=True)
    print(counts)


if __name__ == "__main__":
    main()
