"""Joints between parts by screw decomposition of their motions; the part that each part hangs on."""

import itertools

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from .motions import found_motions
from .rigid_motion import moved
from .segmentation import alternate

# A rotation below this is a slide's, degrees: errors of sensors turn a part by up to 2. A turn is a screw's where it advances by more than
# this many meters a radian (threads of caps advance by more, errors by less) and by more than this many voxels.
SLIDE_DEG, SCREW_PITCH_M, SCREW_VOXELS = 3.0, 0.003, 2.0
# A part hangs on the part that it touches; on the static one where it touches that by at least this share of the most touched.
TOUCH = 0.3


def parents(points, labels, count, voxel_m):
    """The part that each part hangs on: of those nearer to the static one, the one it touches most."""
    trees = [cKDTree(points[labels == k]) if (labels == k).any() else None for k in range(count)]
    touch = np.zeros((count, count))
    for a, b in itertools.combinations(range(count), 2):
        if trees[a] is not None and trees[b] is not None:
            off, _ = trees[a].query(points[labels == b], distance_upper_bound=4 * voxel_m)
            touch[a, b] = touch[b, a] = np.isfinite(off).sum()
    out, placed = [-1] + [0] * (count - 1), {0}
    for k in range(1, count):
        if touch[k, 0] >= TOUCH * touch[k].max():
            placed.add(k)
    while len(placed) < count:
        k, p = max(((k, p) for k in range(count) if k not in placed for p in placed), key=lambda e: touch[e])
        out[k] = p if touch[k, p] else 0
        placed.add(k)
    return out


def joint(motion, voxel_m):
    """Type, axis and a point on it of a motion: screw decomposition."""
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    angle = np.linalg.norm(turn)
    t = motion[:3, 3]
    if np.degrees(angle) < SLIDE_DEG:
        return "prismatic", t / max(np.linalg.norm(t), 1e-12), np.zeros(3)
    axis = turn / angle
    advance = axis @ t
    point = np.linalg.lstsq(np.eye(3) - motion[:3, :3], t - advance * axis, rcond=None)[0]
    screw = abs(advance) > SCREW_VOXELS * voxel_m and abs(advance) / angle > SCREW_PITCH_M
    return "screw" if screw else "revolute", axis, point


def slide_of(motion, points):
    """A small rotation of a slide is error: the displacement of the part's middle is the slide."""
    out = np.eye(4)
    out[:3, 3] = moved(motion, points.mean(0)) - points.mean(0)
    return out


def reconstruct(box, given, surfaces, matches):
    """Joints of a recording, and its static points with their normals, in state 0."""
    rng, voxel_m = np.random.default_rng(0), surfaces[0].volume.voxel_m
    motions, unit_m = found_motions(matches, box, voxel_m, rng)
    started = len(motions)
    motions, points, labels = alternate(motions, surfaces, matches, unit_m, rng)
    hang = parents(points[0][0], labels[0], len(motions), voxel_m)
    # In state 0's world, as if state 1's were the same.
    motions = [np.linalg.inv(motions[0]) @ m for m in motions]
    joints = []
    for k in range(1, len(motions)):
        relative = np.linalg.inv(motions[hang[k]]) @ motions[k]
        kind, axis, point = joint(relative, voxel_m)
        own = points[0][0][labels[0] == k]
        if kind == "prismatic" and len(own):
            relative = slide_of(relative, own)
            axis = joint(relative, voxel_m)[1]
        motion = motions[hang[k]] @ relative
        joints.append({"type": kind, "axis": axis, "origin": point, "motion": motion})
    static = labels[0] == 0
    told = {"box_given": given, "voxel_m": voxel_m, "unit_m": unit_m, "matches": len(matches), "motions_by_ransac": started}
    return joints, (points[0][0][static], points[0][1][static]), told
