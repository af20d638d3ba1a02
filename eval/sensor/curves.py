"""Errors of the twin against the level of the sensor's errors, for each effect alone and for all of them.

    python eval/sensor/curves.py --out DIR [--artitwin PATH] [--only EFFECT,...] [--levels 0,0.25,...] [--classical] [--have] [OBJECT ...]

Needs numpy and scipy (`in_frame.py`); `--classical` puts the classical route beside the program (`classical.py`, and what it needs). Every point has a folder DIR/<effect>/<level>/<object>; what is there is not made again, so a run
that was stopped goes on, and `--have` reports what is there alone. An effect alone stands among things and without masks, as all
of them do. Writes DIR/curves.md and DIR/curves.svg. All of it takes about 20 minutes of two cores for an object and a level.
"""

import json
import statistics
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
from tier import arguments, measure, options  # noqa: E402

# Those that stand around are in every recording.
EFFECTS = [
    "depth_scale", "depth_warp", "depth_noise", "flying_pixels", "depth_loss", "color_shift", "pose_lag", "pose_drift", "pose_jitter",
    "relocalization", "exposure", "vignetting", "light", "highlights", "motion_blur", "hand",
]
ALL = "all"
LEVELS = "0,0.25,0.5,0.75,1,1.25,1.5"
OBJECTS = ["3301:cabinet:2", "3303:clamshell:2", "3302:cabinet:3"]
# Measures of a plot, pixels.
WIDTH, HEIGHT, LEFT, TOP = 230, 130, 46, 26


def sensor(effect, level):
    """Options of `synth`."""
    alone = "" if effect == ALL else f":{effect},clutter"
    return ["--sensor", f"handheld:{level}{alone}"]


def classical_row(folder):
    """The classical route's row of a recording; it is kept beside the recording."""
    from classical import measure as route  # noqa: PLC0415: opencv only where it is asked for

    kept = folder / "classical.json"
    if not kept.exists():
        kept.write_text(json.dumps(route(folder / "object")))
    return json.loads(kept.read_text())


def found(rows):
    """What rows of either method show: objects with the right number of parts and types, the median axis, the worst one."""
    axes = [j["axis_deg"] for r in rows for j in r.get("joints", []) if j.get("axis_deg") is not None]
    return {
        "right": sum("parts" in r and r["found"] == r["parts"] for r in rows),
        "types": sum("parts" in r and r["types"] == r["wanted"] for r in rows),
        "objects": len(rows),
        "axis_deg": statistics.median(axes) if axes else None,
        "worst_deg": max(axes, default=None),
    }


def summary(rows):
    """What a point shows: what was found, and medians of lines and surfaces."""
    made = [r for r in rows if "parts" in r]
    joints = [j for r in made for j in r["joints"]]
    median = lambda values: statistics.median(values) if values else None  # noqa: E731
    return found(rows) | {
        "line_mm": median([j["axis_mm"] for j in joints if j.get("axis_mm") is not None]),
        "seen_mm": median([s for r in made for s in r["seen_mm"] if s is not None]),
    }


def number(value, digits=2):
    return "" if value is None else f"{value:.{digits}f}"


def table(points):
    text = [
        "| effect | level | parts right | types right | axis, median deg | worst deg | line, median mm | seen, median mm | classical: parts, types | axis, median deg | worst deg |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for effect, level, s in points:
        c = s.get("classical")
        beside = f"{c['right']}, {c['types']} of {c['objects']} | {number(c['axis_deg'])} | {number(c['worst_deg'])}" if c else " | | "
        text.append(
            f"| {effect} | {level} | {s['right']} of {s['objects']} | {s['types']} of {s['objects']} | {number(s['axis_deg'])} "
            f"| {number(s['worst_deg'])} | {number(s['line_mm'], 1)} | {number(s['seen_mm'], 1)} | {beside} |"
        )
    return "\n".join(text) + "\n"


def plot(points, effects):
    """A small plot for every effect: the median error of the axis over the level, of the program (green) and of the classical
    route (red); a full dot has all parts right. Errors above twice the program's worst are off the plot."""
    columns = 4
    top = 2 * max([s["axis_deg"] for _, _, s in points if s["axis_deg"] is not None] + [0.125])
    last = max([float(level) for _, level, _ in points] + [1e-9])
    rows = -(-len(effects) // columns)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{columns * WIDTH}" height="{rows * HEIGHT}" font-family="sans-serif" font-size="10">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for k, effect in enumerate(effects):
        x0, y0 = k % columns * WIDTH + LEFT, k // columns * HEIGHT + TOP
        w, h = WIDTH - LEFT - 12, HEIGHT - TOP - 24
        place = lambda level, s: (x0 + w * float(level) / last, y0 + h * (1 - s["axis_deg"] / top))  # noqa: E731
        out.append(f'<path d="M{x0} {y0}v{h}h{w}" fill="none" stroke="#888"/><text x="{x0}" y="{y0 - 8}">{effect}</text>')
        out.append(f'<text x="{x0 - 4}" y="{y0 + 6}" text-anchor="end">{top:.2g} deg</text><text x="{x0 + w}" y="{y0 + h + 12}" text-anchor="end">level {last:g}</text>')
        own = [(level, s) for e, level, s in points if e == effect]
        for curve, hue in ((own, "#2a6"), ([(level, s.get("classical", {})) for level, s in own], "#c43")):
            dots = [(place(level, s), s) for level, s in curve if s.get("axis_deg") is not None and s["axis_deg"] <= top]
            path = " ".join(f"{x:.1f},{y:.1f}" for (x, y), _ in dots)
            out.append(f'<polyline points="{path}" fill="none" stroke="{hue}"/>')
            out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" stroke="{hue}" fill="{hue if s["right"] == s["objects"] else "white"}"/>' for (x, y), s in dots]
    return "\n".join([*out, "</svg>", ""])


def main():
    parser = arguments(__doc__)
    parser.add_argument("--only", default="", help=f"effects, and {ALL}; default: each and {ALL}")
    parser.add_argument("--levels", default=LEVELS)
    parser.add_argument("--classical", action="store_true", help="the classical route beside the program")
    parser.add_argument("--have", action="store_true", help="report what is there, make nothing")
    parser.add_argument("objects", nargs="*", default=OBJECTS)
    args = parser.parse_args()
    effects = args.only.split(",") if args.only else [ALL, *EFFECTS]
    unknown = sorted(set(effects) - {ALL, *EFFECTS})
    if unknown:
        parser.error(f"no effect {', '.join(unknown)}; give some of {ALL}, {', '.join(EFFECTS)}")
    points = []
    for effect in effects:
        for level in args.levels.split(","):
            rows, beside = [], []
            for name in args.objects:
                folder = args.out / effect / level / name.replace(":", "-")
                if args.have and not (folder / "runs" / "object").exists():
                    continue
                rows.append(measure(folder, [*options(name), *sensor(effect, level)], args))
                if args.classical:
                    beside.append(classical_row(folder))
            if rows:
                points.append((effect, level, summary(rows) | ({"classical": found(beside)} if beside else {})))
                print(table(points[-1:]).splitlines()[-1], flush=True)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "points.json").write_text(json.dumps(points, indent=1))
    (args.out / "curves.md").write_text(table(points))
    (args.out / "curves.svg").write_text(plot(points, effects))


if __name__ == "__main__":
    main()
