#!/usr/bin/env python3
"""How time and memory of `reconstruct` grow with frames, image size and parts, on objects made by `artitwin synth`.

    benches/growth.py [--out DIR] [--seeds N]

Prints a table and writes growth.svg: processor seconds and peak memory against each of the three, the others held.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "artitwin"
SWEEPS = {
    "frames of each state": [("frames", n) for n in (10, 20, 30, 40)],
    "pixels of an image, thousands": [("width", w) for w in (160, 320, 480, 640)],
    "parts": [("parts", n) for n in (2, 3, 4, 5, 6)],
}
BASE = {"frames": 20, "width": 320, "parts": 3}


def run(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ended = subprocess.run([str(c) for c in command], cwd=ROOT, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return ended, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(settings, seed, out):
    """Processor seconds and peak gigabytes of one object; None where it was refused."""
    width = settings["width"]
    name = f"p{settings['parts']}w{width}f{settings['frames']}s{seed}"
    if not (out / name).exists():
        ended, _ = run([PROGRAM, "synth", "--out", out / name, "--seed", seed, "--family", "cabinet", "--textured", "--parts",
                        settings["parts"], "--views", settings["frames"], "--width", width, "--height", width * 3 // 4])
        if ended.returncode:
            sys.exit(ended.stderr)
    ended, seconds = run(["/usr/bin/env", "time", "-f", "%M", PROGRAM, "reconstruct", out / name, "--parts", settings["parts"],
                          "--out", out / "runs"])
    if ended.returncode not in (0, 3):
        print(f"{name}: {ended.stderr.strip().splitlines()[-2]}", file=sys.stderr)
        return None
    return seconds, int(ended.stderr.strip().splitlines()[-1]) / 1e6


def panel(x0, title, points):
    """A plot of seconds (left axis, from 0) against the swept quantity (from 0)."""
    width, height = 250, 170
    x_most, y_most = max(p[0] for p in points), max(p[1] for p in points) * 1.1
    at = lambda p: (x0 + width * p[0] / x_most, 200 - height * p[1] / y_most)
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(at, points))
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3"/><text x="{x:.1f}" y="{y - 8:.1f}" text-anchor="middle">{p[1]:.0f} s</text>'
                   for p, (x, y) in zip(points, map(at, points)))
    ticks = "".join(f'<text x="{at(p)[0]:.1f}" y="215" text-anchor="middle">{p[0]:g}</text>' for p in points)
    return (f'<path d="M{x0},30 V200 H{x0 + width}" fill="none" stroke="gray"/><polyline points="{line}" fill="none" stroke="black"/>'
            f'{dots}{ticks}<text x="{x0 + width / 2}" y="235" text-anchor="middle">{title}</text>')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("/tmp/artitwin-growth"))
    parser.add_argument("--seeds", type=int, default=2)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print("| swept | value | processor, s | peak memory, GB |\n|---|---|---|---|")
    panels = []
    for k, (title, values) in enumerate(SWEEPS.items()):
        points = []
        for key, value in values:
            settings = BASE | {key: value}
            found = [m for seed in range(arguments.seeds) if (m := measure(settings, seed, arguments.out))]
            if not found:
                continue
            seconds, memory = statistics.mean(m[0] for m in found), max(m[1] for m in found)
            shown = value * value * 3 / 4 / 1000 if key == "width" else value
            points.append((shown, seconds))
            print(f"| {title} | {shown:g} | {seconds:.1f} | {memory:.2f} |", flush=True)
        panels.append(panel(40 + 310 * k, title, points))
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" width="960" height="245" font-family="sans-serif" font-size="11">{"".join(panels)}</svg>'
    (arguments.out / "growth.svg").write_text(svg)
    print(f"\nplot: {arguments.out / 'growth.svg'}")


if __name__ == "__main__":
    main()
