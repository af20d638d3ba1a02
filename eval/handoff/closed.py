"""Where finished runs put the closed end of their joints, against the truth.

    python closed.py TRUTH_FOLDER RUN [RUN ...]

TRUTH_FOLDER/NAME/truth.json holds parts with axis, q0 (position in state 0; 0 is closed) and motion. Joints
are matched by axis and motion. Prints a row a joint: true and found closed position, measured from state 0,
in m or rad, what is off in mm or rad, and the share of the face that meets its seat.

Needs numpy.
"""
import json
import sys
from pathlib import Path

import numpy as np


def matched(joint, parts):
    motion = joint["motion"]["value"]
    def misfit(part):
        across = np.linalg.norm(np.cross(part["axis"], joint["axis"]))
        return across + abs(abs(part["motion"]) - abs(motion)) / abs(motion)
    return min(parts, key=misfit)


def main():
    truths, runs = Path(sys.argv[1]), [Path(r) for r in sys.argv[2:]]
    print("| joint | true part | closed | found | off | share |\n|---|---|---|---|---|---|")
    for run in runs:
        report = json.loads((run / "report.json").read_text())
        parts = json.loads((truths / report["name"] / "truth.json").read_text())["parts"][1:]
        for joint in report["joints"]:
            part = matched(joint, parts)
            if not 0 in part["limits"]:
                continue
            true = -part["q0"] * np.sign(np.dot(part["axis"], joint["axis"]))
            seat, turns = joint["limit"]["closed"], joint["motion"]["unit"] == "rad"
            if seat is None:
                # Without a seat the end is what was observed with a margin.
                lower, upper = joint["limit"]["lower"], joint["limit"]["upper"]
                end = min((lower, upper), key=lambda q: abs(q - true))
                found, share = f"- (ends at {end:.4f})", "-"
            else:
                end = seat["position"]
                found, share = f"{end:.4f} +- {seat['std']:.4f}", f"{100 * seat['contact_share']:.0f} %"
            off = f"{end - true:+.4f} rad" if turns else f"{1e3 * (end - true):+.1f} mm"
            print(f"| {report['name']} {joint['name']} | {part['name']} | {true:.4f} | {found} | {off} | {share} |")


main()
