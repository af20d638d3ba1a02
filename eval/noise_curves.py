#!/usr/bin/env python3
"""Joint errors against the noise and the amount of what was recorded, and whether they are as large as the twin says.

    python eval/noise_curves.py --out DIR [--artitwin PATH] [--preset NAME] [--only SWEEP,...] [--have]

Needs Python 3 and the program. The same objects are made at every point of every sweep, with the true number of parts given.
Every point has a folder DIR/<point>/<seed>; what is there is not made again, so a run that was stopped goes on, and `--have`
reports what is there alone. Prints a table and writes DIR/noise_curves.md and DIR/noise_curves.svg: errors of axis (degrees),
line (millimeters, at the joint's place) and motion (degrees, or millimeters of a slide), and for each the root mean square of
error / stated deviation with the share of joints within 1 and 2 deviations. A joint of a wrong type, or whose motion is off by
more than a half, was not found: its errors are not those of noise.
"""

import argparse
import json
import math
import statistics
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from random_objects import percentile, score  # noqa: E402

# Seed and kind of the objects.
OBJECTS = [
    (3110, "--family cabinet --parts 3"),
    (3111, "--family clamshell"),
    (3113, "--family cabinet --parts 2"),
]
VIEWS = 20
IMAGE = "--textured --width 320 --height 240"
# Sweep -> name of a point, options of synth, options of reconstruct. The point "base" belongs to every sweep that shows it.
BASE = ("base", "", "")
SWEEPS = {
    "pose noise, mm and deg": [
        ("0, 0", *BASE[1:]),
        ("1, 0.1", "--poses noisy:1,0.1", ""),
        ("2, 0.2", "--poses noisy:2,0.2", ""),
        ("5, 0.5", "--poses noisy:5,0.5", ""),
    ],
    "depth noise, times": [("0.5", "--noise 0.5", ""), ("1", *BASE[1:]), ("2", "--noise 2", ""), ("4", "--noise 4", "")],
    "drift, mm and deg": [("0, 0", *BASE[1:]), ("50, 5", "--drift 50,5", "")],
    "masks": [("given", *BASE[1:]), ("missing", "", "--set capture.isolate.use_masks=false")],
    "motion, share": [("0.25", "--motion-scale 0.25", ""), ("0.5", "--motion-scale 0.5", ""), ("1", *BASE[1:])],
    "views of a state": [("5", "--views 5", ""), ("10", "--views 10", ""), ("20", *BASE[1:]), ("40", "--views 40", "")],
}
QUANTITIES = ["axis, deg", "line, mm", "turn, deg", "slide, mm"]
# Within this factor a stated deviation counts as right.
CALIBRATED = 1.5
# A motion off by this share was not found.
WRONG = 0.5


def folder_of(synth, reconstruct):
    """Name of a point's folder: points with the same options share it."""
    text = f"{synth} {reconstruct}".strip() or BASE[0]
    return "".join(c if c.isalnum() or c in ".-" else "_" for c in text.replace("--", ""))


def measure(synth, reconstruct, args):
    """Joints of all objects at a point: errors and stated deviations by quantity."""
    joints, failures = [], []
    for seed, kind in OBJECTS:
        point = args.out / folder_of(synth, reconstruct)
        if args.have and not (point / str(seed) / "runs" / "object").exists():
            continue
        views = "" if "--views" in synth else f"--views {VIEWS}"
        run = argparse.Namespace(
            out=point, artitwin=args.artitwin, preset=args.preset, give_parts=True,
            synth=f"{kind} {IMAGE} {views} {synth}", reconstruct=reconstruct,
        )
        row = score(seed, run)
        if "failure" in row:
            failures.append(f"{folder_of(synth, reconstruct)}, seed {seed}: {row['failure']}")
        if "joints" not in row:
            continue
        truth = {p["name"]: p for p in json.loads((point / str(seed) / "object" / "truth.json").read_text())["parts"]}
        report = json.loads((point / str(seed) / "runs" / "object" / "report.json").read_text())
        stated = {j["name"]: j for j in report["joints"]}
        for joint in row["joints"]:
            part = truth[joint["part"]]
            found = joint.get("type_right") and off_by(stated[joint["joint"]], part) < WRONG * abs(part["motion"])
            joints.append(compare(joint, part, stated[joint["joint"]]) if found else {})
            if joint.get("type_right") and not found:
                failures.append(f"{point.name}, seed {seed}: {joint['part']} has a wrong motion")
    return joints, failures


def off_by(stated, truth):
    """Error of the motion, radians or meters."""
    return abs(abs(stated["motion"]["value"]) - abs(truth["motion"]))


def compare(found, truth, stated):
    """Error and stated deviation of a joint by quantity."""
    turns = truth["type"] != "prismatic"
    motion = off_by(stated, truth)
    values = {"axis, deg": (found["axis_deg"], stated["axis_std_deg"])}
    if turns:
        values["line, mm"] = (1e3 * off_line(stated["origin"], truth["origin"], truth["axis"]), stated["origin_std_mm"])
        values["turn, deg"] = (math.degrees(motion), math.degrees(stated["motion_std"]["value"]))
    else:
        values["slide, mm"] = (1e3 * motion, 1e3 * stated["motion_std"]["value"])
    return values


def off_line(point, origin, direction):
    """Distance of a point from a line of unit direction."""
    offset = [p - o for p, o in zip(point, origin)]
    along = sum(a * b for a, b in zip(offset, direction))
    return math.sqrt(sum((a - along * b) ** 2 for a, b in zip(offset, direction)))


def errors(joints, quantity):
    return [j[quantity][0] for j in joints if quantity in j]


def ratios(joints, quantities):
    """Errors in stated deviations."""
    return [j[q][0] / max(j[q][1], 1e-9) for j in joints for q in quantities if q in j]


def root_mean_square(values):
    return math.sqrt(statistics.fmean(v * v for v in values)) if values else float("nan")


def table(points):
    """Points one a line: median and worst errors, and the calibration."""
    text = [
        "| | | joints | " + " | ".join(f"{q}" for q in QUANTITIES) + " | error / stated, RMS | within 1 | within 2 |",
        "|---|---|---|" + "---|" * (len(QUANTITIES) + 3),
    ]
    for sweep, name, joints in points:
        cells = []
        for quantity in QUANTITIES:
            values = errors(joints, quantity)
            cells.append(f"{statistics.median(values):.2f} ({max(values):.2f})" if values else "")
        z = ratios(joints, QUANTITIES)
        within = [100 * statistics.fmean(v <= k for v in z) if z else float("nan") for k in (1, 2)]
        right = sum(bool(j) for j in joints)
        cells += [f"{root_mean_square(z):.2f}", f"{within[0]:.0f} %", f"{within[1]:.0f} %"]
        text.append(f"| {sweep} | {name} | {right} of {len(joints)} | " + " | ".join(cells) + " |")
    return "\n".join(text) + "\n"


def summary(points):
    """The calibration of each quantity over all points, each counted once."""
    unique = {folder: joints for folder, joints in points}
    text = ["| | errors | error / stated, RMS | median | within 1 | within 2 |", "|---|---|---|---|---|---|"]
    for quantity in QUANTITIES:
        z = [r for joints in unique.values() for r in ratios(joints, [quantity])]
        if z:
            within = [100 * statistics.fmean(v <= k for v in z) for k in (1, 2)]
            text.append(
                f"| {quantity} | {len(z)} | {root_mean_square(z):.2f} | {statistics.median(z):.2f} "
                f"| {within[0]:.0f} % | {within[1]:.0f} % |"
            )
    return "\n".join(text) + "\n"


def panel(x0, y0, names, values, low, high):
    """A small plot with a logarithmic axis: every joint a dot, medians joined."""
    width, height = 130, 90
    at_x = lambda k: x0 + width * (k + 0.5) / len(names)
    at_y = lambda v: y0 + height * (1 - (math.log10(max(v, low)) - math.log10(low)) / (math.log10(high) - math.log10(low)))
    parts = [f'<path d="M{x0},{y0} V{y0 + height} H{x0 + width}" fill="none" stroke="#999"/>']
    decade = 10 ** math.ceil(math.log10(low))
    while decade <= high:
        y = at_y(decade)
        parts.append(f'<path d="M{x0},{y:.1f} H{x0 + width}" stroke="#ddd"/><text x="{x0 - 4}" y="{y + 3:.1f}" text-anchor="end">{decade:g}</text>')
        decade *= 10
    medians = [(at_x(k), at_y(statistics.median(v))) for k, v in enumerate(values) if v]
    parts += [f'<circle cx="{at_x(k):.1f}" cy="{at_y(v):.1f}" r="2" fill="#7799bb"/>' for k, of in enumerate(values) for v in of]
    parts.append(f'<polyline points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in medians)}" fill="none" stroke="black"/>')
    parts += [f'<text x="{at_x(k):.1f}" y="{y0 + height + 12}" text-anchor="middle">{name}</text>' for k, name in enumerate(names)]
    return "".join(parts)


def plot(points):
    """Quantities in rows, sweeps in columns, and a row of calibration."""
    rows = [(q, lambda joints, q=q: errors(joints, q)) for q in QUANTITIES]
    rows.append(("error / stated", lambda joints: ratios(joints, QUANTITIES)))
    columns, across, down = list(SWEEPS), 175, 125
    parts = []
    for r, (title, values_of) in enumerate(rows):
        everything = [v for _, _, joints in points for v in values_of(joints) if v > 0]
        if not everything:
            continue
        low, high = max(percentile(everything, 0.05), 1e-4) / 2, max(everything) * 1.3
        parts.append(f'<text transform="translate(14,{60 + r * down + 45}) rotate(-90)" text-anchor="middle" font-weight="bold">{title}</text>')
        for c, sweep in enumerate(columns):
            own = [(name, values_of(joints)) for s, name, joints in points if s == sweep]
            if own:
                parts.append(panel(60 + c * across, 40 + r * down, [n for n, _ in own], [v for _, v in own], low, high))
                if title == "error / stated":
                    y = 40 + r * down + 90 * (1 - (0 - math.log10(low)) / (math.log10(high) - math.log10(low)))
                    parts.append(f'<path d="M{60 + c * across},{y:.1f} h130" stroke="#c00" stroke-dasharray="4 3"/>')
    parts += [f'<text x="{60 + c * across + 65}" y="25" text-anchor="middle" font-weight="bold">{s}</text>' for c, s in enumerate(columns)]
    width, height = 60 + len(columns) * across, 50 + len(rows) * down
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
            f'font-family="sans-serif" font-size="10"><rect width="100%" height="100%" fill="white"/>{"".join(parts)}</svg>\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--preset", default="preview")
    parser.add_argument("--only", default="", help="sweeps that hold one of these words, separated by commas")
    parser.add_argument("--have", action="store_true", help="make nothing: report the runs that are there")
    args = parser.parse_args()
    wanted = [w for w in args.only.split(",") if w]
    points, unique, failures = [], [], []
    for sweep, settings in SWEEPS.items():
        if wanted and not any(w in sweep for w in wanted):
            continue
        for name, synth, reconstruct in settings:
            joints, failed = measure(synth, reconstruct, args)
            points.append((sweep, name, joints))
            unique.append((folder_of(synth, reconstruct), joints))
            failures += [f for f in failed if f not in failures]
            if not joints:  # nothing of it was asked for
                points.pop()
                continue
            print(f"{sweep} {name}: {sum(bool(j) for j in joints)} of {len(joints)} joints", file=sys.stderr, flush=True)
    text = "\n".join([
        f"Errors as median (worst). {len(OBJECTS)} textured objects, the same at every point, {VIEWS} views of 320x240 a state, preset "
        f"`{args.preset}`, parts given; joints not found have no error. A stated deviation is right where the root mean square of",
        f"error / stated lies between 1/{CALIBRATED} and {CALIBRATED}. Made by `eval/noise_curves.py`.",
        "",
        table(points),
        "All points together:",
        "",
        summary(unique),
        *[f"- {f}" for f in failures],
    ]) + "\n"
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "noise_curves.md").write_text(text)
    (args.out / "noise_curves.svg").write_text(plot(points))
    print(text, end="")


if __name__ == "__main__":
    main()
