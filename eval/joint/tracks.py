"""Types, deviations and repeats of measured tracks: python3 tracks.py PROGRAM FOLDER [FALSE_SLIDE,...] > table.

The name says the type: drawers and sliding cabinets slide, all else turns; names of slides among others are
listed. Files of one name before the last `_` are repeats of one mechanism.
"""

import json
import statistics
import subprocess
import sys
from pathlib import Path


def joint(program: str, *tracks: Path) -> dict:
    done = subprocess.run([program, "joint", "--json", *tracks], capture_output=True, text=True, check=False)
    return json.loads(done.stdout)


def spread(rows: list[list[float]]) -> float:
    """Standard deviation of a coordinate of unit vectors, which have two."""
    return (sum(statistics.variance(column) for column in zip(*rows, strict=True)) / 2) ** 0.5


def main() -> None:
    program, folder = sys.argv[1], Path(sys.argv[2])
    slides = sys.argv[3].split(",") if len(sys.argv) > 3 else []
    repeats: dict[str, list[tuple[Path, dict]]] = {}
    counts = {"right": 0, "undecided": 0, "false": 0}
    print("| track | type | ln odds |\n|---|---|---|")
    for path in sorted(folder.glob("*.log")):
        found = joint(program, path)
        is_slide = path.stem.startswith(("drawer", "sliding")) or path.stem in slides
        wanted = "prismatic" if is_slide else "revolute"
        word = "right" if found["type"] == wanted else "undecided" if found["axis"] is None else "false"
        counts[word] += 1
        print(f"| {path.stem} | {found['type']} ({word}) | {found['log_odds_revolute']:.1f} |")
        if not path.stem.startswith("kitchen"):
            repeats.setdefault(path.stem.rpartition("_")[0], []).append((path, found))
    print(f"\n{counts}\n\n| mechanism | type of all | axis: spread / stated | radius: spread / stated |\n|---|---|---|---|")
    for name, all_found in repeats.items():
        known = [found for _, found in all_found if found["axis"] is not None]
        if len(known) < 2:
            continue
        first = known[0]["axis"]
        signs = [1 if sum(a * b for a, b in zip(first, k["axis"], strict=True)) > 0 else -1 for k in known]
        axes = [[sign * a for a in k["axis"]] for sign, k in zip(signs, known, strict=True)]
        stated = statistics.mean(k["axis_std_rad"] ** 2 for k in known) ** 0.5
        text = f"| {name} | {joint(program, *[p for p, _ in all_found])['type']} | {spread(axes) / stated:.2f} |"
        radii = [o["openings"][0] for o in known if o["openings"][0]["radius_m"]]
        if len(radii) > 1:
            own = statistics.mean(o["radius_std_m"] ** 2 for o in radii) ** 0.5
            text += f" {statistics.stdev(o['radius_m'] for o in radii) / own:.2f} |"
        else:
            text += " |"
        print(text)


if __name__ == "__main__":
    main()
