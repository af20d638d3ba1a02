"""Errors of the joints found, against the truth of a recording."""

import json

import numpy as np
from scipy.optimize import linear_sum_assignment

from in_frame import align
from tier import TYPES

from .motions import STATIC_DEG
from .rigid_motion import moved, turn_deg


def line_distance_m(a, u, b, v):
    """Between two lines, (13.1) of docs/method.md; parallel ones keep their gap."""
    across = np.cross(u, v)
    if np.linalg.norm(across) < 1e-6:
        return float(np.linalg.norm(np.cross(a - b, v)))
    return float(abs((a - b) @ across) / np.linalg.norm(across))


def true_points(recording, state):
    """The true surface points of a state, with the indices of their parts."""
    return np.load(recording / "truth" / f"state{state}" / "seen.npy").astype(float)


def part_points(recording, part):
    """The true surface of a part in state 0."""
    for state in (0, 1):
        seen = true_points(recording, state)
        own = seen[seen[:, 3] == part["index"], :3]
        if len(own):
            return moved(np.linalg.inv(part["state1_from_state0"]), own) if state else own
    return np.array([part["origin"]], float)


def scored(recording, joints, static, surface):
    """Errors of the joints after the truth was moved onto the static points, and by how much: degrees, and millimeters at the object.

    `static` and `surface`: points and normals of the static part and of everything, in state 0.
    """
    truth = json.loads((recording / "truth.json").read_text())
    seen = true_points(recording, 0)
    frame, whole = align(seen[seen[:, 3] == 0][:, :3], *static), align(seen[:, :3], *surface)
    # A round foot leaves the turn about its own axis open; the whole of state 0 does not.
    frame = whole if turn_deg(frame[:3, :3] @ whole[:3, :3].T) > STATIC_DEG else frame
    center = seen[:, :3].mean(0)
    off = [float(turn_deg(frame[:3, :3])), float(1e3 * np.linalg.norm(moved(frame, center) - center))]
    parts = [p for p in truth["parts"] if "axis" in p]
    inverse = np.linalg.inv(frame)
    true = [frame @ np.array(p["state1_from_state0"]) @ inverse for p in parts]
    surfaces = [moved(frame, part_points(recording, p)) for p in parts]
    cost = np.array([[np.linalg.norm(moved(m, x) - moved(j["motion"], x), axis=1).mean() for j in joints] for m, x in zip(true, surfaces)])
    pairs = dict(zip(*(x.tolist() for x in linear_sum_assignment(cost)))) if joints else {}
    rows = []
    for k, part in enumerate(parts):
        row = {"part": part["name"], "type_true": part["type"]}
        if k not in pairs:
            rows.append(row | {"missing": True})
            continue
        found = joints[pairs[k]]
        axis, origin = frame[:3, :3] @ part["axis"], moved(frame, np.array(part["origin"], float))
        across = np.linalg.norm(np.cross(found["axis"], axis))
        row |= {"type": found["type"], "error_mm": 1e3 * cost[k, pairs[k]]}
        row["axis_deg"] = float(np.degrees(np.arctan2(across, abs(found["axis"] @ axis))))
        if part["type"] == "prismatic":
            row["motion_mm"] = float(1e3 * np.linalg.norm(found["motion"][:3, 3] - true[k][:3, 3]))
        else:
            if found["type"] != "prismatic":
                row["axis_mm"] = 1e3 * line_distance_m(found["origin"], found["axis"], origin, axis)
            row["motion_deg"] = float(turn_deg(found["motion"][:3, :3] @ true[k][:3, :3].T))
        rows.append(row)
    return {
        "parts": len(truth["parts"]),
        "found": 1 + len(joints),
        "wanted": sorted(TYPES[p["type"]] for p in parts),
        "types": sorted(TYPES[j["type"]] for j in joints),
        "joints": rows,
        "frame": off,
    }
