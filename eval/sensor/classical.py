"""What a classical registration route finds in a recording: a baseline beside the program, scored as `in_frame.py` scores it.

    python eval/sensor/classical.py RECORDING [RECORDING ...] [--json FILE]

A RECORDING is a folder as `synth --sensor handheld` makes it: state0/ and state1/ (MCAP), truth.json, truth/, workspace.txt. Without
workspace.txt the box is that of the true points with a margin, 6 mm above the floor, and the row says so. Masks and the true number
of parts are not used. Depth and poses are taken as they are: the route has no calibration of its own. Needs numpy, scipy,
opencv-python-headless and mcap. The same recording gives the same row, but for its seconds.

The route (shared/docs/registration.md, with better matches and a choice of the number of parts): a truncated signed distance volume for
each state; RootSIFT matches between all views of the two states, lifted onto its surface, of equal size and with a rotation of their own;
the static motion near the identity, then further ones by sequential RANSAC; in turn, labels of the surface points of both states, a
choice of the motions that explain what no other does, and point to plane refinement of each; joints by screw decomposition. A part
hangs on the part that it touches. Half a minute of two cores for a recording.
"""

import argparse
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from classical_route.joints import reconstruct  # noqa: E402
from classical_route.matches import observed  # noqa: E402
from classical_route.score import scored  # noqa: E402
from tier import errors  # noqa: E402


def measure(recording):
    """A recording's row."""
    # `tier.py` calls every recording "object", in a folder of its own.
    row, start = {"name": recording.resolve().parent.name if recording.name == "object" else recording.name}, time.monotonic()
    try:
        seen = observed(recording)
        joints, static, told = reconstruct(*seen)
        row |= told | {"seconds": time.monotonic() - start}
        return row | scored(recording, joints, static, (seen[2][0].points, seen[2][0].normals))
    except Exception as error:  # noqa: BLE001: one bad recording must not end the others
        said = f"{type(error).__name__}: {error}".replace("|", "/").replace("\n", " ")
        return row | {"failure": said, "seconds": time.monotonic() - start}


def listed(joints, key, digits):
    return ", ".join(f"{j[key]:.{digits}f}" for j in joints if key in j)


def line(row):
    """A row of the table."""
    if "failure" in row:
        return f"| {row['name']} | {row['failure']} |  |  |  |  | {row['seconds']:.0f} |"
    found = [j for j in row["joints"] if not j.get("missing")]
    motion = [f"{j['motion_deg']:.2f} deg" if "motion_deg" in j else f"{j['motion_mm']:.1f} mm" for j in found]
    types = "right" if row["types"] == row["wanted"] else f"{', '.join(row['types']) or 'none'} ({', '.join(row['wanted'])})"
    name = row["name"] if row["box_given"] else f"{row['name']} (box of the truth)"
    axes = ", ".join("missed" if j.get("missing") else f"{j['axis_deg']:.2f}" for j in row["joints"])
    return (
        f"| {name} | {row['found']} ({row['parts']}) | {types} | {axes} "
        f"| {listed(row['joints'], 'axis_mm', 1)} | {', '.join(motion)} | {row['seconds']:.0f} |"
    )


def summary(rows):
    joints = [j for r in rows for j in r.get("joints", [])]
    return "; ".join([*errors(rows), f"joints missed: {sum(j.get('missing', False) for j in joints)} of {len(joints)}"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--json", type=Path, help="file for all rows with their details")
    args = parser.parse_args()
    print("| object | parts (true) | types | axis, deg | line, mm | motion | seconds |\n|---|---|---|---|---|---|---|", flush=True)
    rows = []
    for recording in args.recordings:
        rows.append(measure(recording))
        print(line(rows[-1]), flush=True)
    print(f"\n{summary(rows)}")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
