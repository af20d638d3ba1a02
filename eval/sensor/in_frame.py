"""Measures a run of `artitwin` in the twin's own frame: the truth is moved onto the twin's static part first.

    python eval/sensor/in_frame.py TRUTH RUN [--artitwin PATH]

Needs Python 3, numpy and scipy, and the program. A frame that is off as a whole is no fault of the joints, so it is reported by
itself (degrees, and millimeters at the object): poses of odometry have no absolute frame. The twin's root link must be the
static part; where the program took another part to be static, the frame's error says so by its size.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

# Distances within which points are paired, in turn, meters.
REACHES = (0.06, 0.03, 0.012, 0.006)
ROUNDS = 15
SAMPLES = 150_000
# Root mean square change of distances by a unit twist (turn in radii of the surface) below which the surface slides within itself: a
# round foot does so about its middle, 0.08; of the other objects of README.md the least was 0.17. Such a twist is not taken.
SLIDES = 0.12


def static_surface(run):
    """Points and normals on the mesh of the twin's root link, which stands in the world."""
    vertices, triangles = [], []
    for line in (run / "meshes" / "visual" / "base.obj").read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(x) for x in words[1:4]])
        elif words[:1] == ["f"]:
            triangles.append([int(w.split("/")[0]) - 1 for w in words[1:4]])
    corners = np.array(vertices)[np.array(triangles)]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    rng = np.random.default_rng(0)
    pick = rng.choice(len(area), SAMPLES, p=area / area.sum())
    u, v = rng.random((2, SAMPLES, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = corners[pick].transpose(1, 0, 2)
    return a + u * (b - a) + v * (c - a), cross[pick] / area[pick, None]


def align(points, surface, normals, start):
    """The rigid motion near `start` that moves points onto a surface, point to plane; without twists that the surface makes within
    itself."""
    tree, motion = cKDTree(surface), start
    for reach in REACHES:
        for _ in range(ROUNDS):
            moved = points @ motion[:3, :3].T + motion[:3, 3]
            off, at = tree.query(moved, distance_upper_bound=reach)
            near = np.isfinite(off)
            if near.sum() < 100:
                break
            p, n = moved[near], normals[at[near]]
            middle = p.mean(0)
            radius = np.sqrt(((p - middle) ** 2).sum(1).mean())
            rows = np.hstack([np.cross((p - middle) / radius, n), n])
            changes, twists = np.linalg.eigh(rows.T @ rows / len(rows))
            held = twists[:, changes > SLIDES**2]
            step = held @ np.linalg.lstsq(rows @ held, np.einsum("ij,ij->i", surface[at[near]] - p, n), rcond=None)[0]
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(step[:3] / radius).as_matrix()
            turn[:3, 3] = middle + step[3:] - turn[:3, :3] @ middle
            motion = turn @ motion
    return motion


def moved_ply(data, motion):
    """A PLY as `synth` writes it, with its vertices moved."""
    head = data.index(b"end_header\n") + len(b"end_header\n")
    count = int(data[:head].split(b"element vertex ")[1].split()[0])
    vertices = np.frombuffer(data, "<f4", 3 * count, head).reshape(-1, 3)
    moved = (vertices @ motion[:3, :3].T + motion[:3, 3]).astype("<f4")
    return data[:head] + moved.tobytes() + data[head + 12 * count :]


def in_frame(truth, run, artitwin, start=None):
    """The evaluation of a run in its own frame, and by how much that is off `start`, the frame that is expected (a 4x4 matrix, twin from
    truth; the same by default): degrees, and millimeters at the object."""
    start = np.eye(4) if start is None else start
    seen = np.load(truth / "truth" / "state0" / "seen.npy").astype(float)
    static = seen[seen[:, 3] == 0][:, :3]
    motion = align(static, *static_surface(run), start)
    off = np.linalg.inv(start) @ motion
    off_deg = np.degrees(np.linalg.norm(Rotation.from_matrix(off[:3, :3]).as_rotvec()))
    center = seen[:, :3].mean(0)
    off_mm = 1e3 * np.linalg.norm(off[:3, :3] @ center + off[:3, 3] - center)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "object"
        copy.mkdir()
        shutil.copytree(truth / "truth", copy / "truth")
        told = json.loads((truth / "truth.json").read_text())
        inverse = np.linalg.inv(motion)
        for part in told["parts"]:
            if "axis" in part:
                part["axis"] = (motion[:3, :3] @ part["axis"]).tolist()
                part["origin"] = (motion[:3, :3] @ part["origin"] + motion[:3, 3]).tolist()
                part["state1_from_state0"] = (motion @ np.array(part["state1_from_state0"]) @ inverse).tolist()
        (copy / "truth.json").write_text(json.dumps(told))
        for file in copy.glob("truth/state*/*.ply"):
            file.write_bytes(moved_ply(file.read_bytes(), motion))
        for file in copy.glob("truth/state*/seen.npy"):
            points = np.load(file)
            points[:, :3] = points[:, :3] @ motion[:3, :3].T + motion[:3, 3]
            np.save(file, points)
        ended = subprocess.run([artitwin, "evaluate", run, "--truth", copy, "--json"], capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RuntimeError(ended.stderr.strip())
    return json.loads(ended.stdout)["trials"][0], [off_deg, off_mm]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path)
    parser.add_argument("run", type=Path)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    args = parser.parse_args()
    trial, frame = in_frame(args.truth, args.run, args.artitwin)
    print(json.dumps({"frame_deg": frame[0], "frame_mm": frame[1]} | trial, indent=1))


if __name__ == "__main__":
    main()
