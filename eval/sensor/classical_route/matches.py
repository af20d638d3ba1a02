"""Matches of RootSIFT features between the states, lifted onto the fused surfaces."""

import itertools
import math
from dataclasses import dataclass

import cv2
import numpy as np

from .recording import frames_of, in_box, lifted, pixel_rays, workspace
from .rigid_motion import moved
from .volume import JUMP, TRUNCATION, Surface

# Voxels along the longest side of the box.
VOXELS = 150
# Features of a frame, their least contrast, ratio of the best to the second distance.
FEATURES, CONTRAST, RATIO = 3000, 0.01, 0.85
# A match is between features of a size up to this factor. It tells a rotation by itself; trace of the rotation between that and a
# motion that it follows: less than 40 degrees.
SIZE, MIN_TRACE = 1.5, 1 + 2 * math.cos(math.radians(40))


def features(frame, surface, box):
    """A frame's features that lie on the surface in the box: descriptors, places in the world, rotations there, sizes in meters.

    A rotation's columns are the feature's own direction on the surface, a third one, and the normal.
    """
    depth, turn = frame.depth_m, frame.pose[:3, :3]
    world = lifted(frame) @ turn.T.astype(np.float32) + frame.pose[:3, 3].astype(np.float32)
    inside = (depth > 0) & in_box(world, box)
    mask = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3))) * 255
    gray = cv2.cvtColor(frame.color, cv2.COLOR_BGR2GRAY)
    points, descriptors = cv2.SIFT_create(FEATURES, contrastThreshold=CONTRAST).detectAndCompute(gray, mask)
    if not points:
        return np.zeros((0, 128), np.float32), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
    own = np.array([[np.cos(np.radians(p.angle)), np.sin(np.radians(p.angle)), p.size] for p in points])
    at = np.array([p.pt for p in points])
    u, v = np.rint(at).astype(int).clip(1, np.array(depth.shape[::-1]) - 2).T
    # Median of the 3 x 3 pixels around, where most have a depth and none is beyond a jump.
    patch = np.stack([depth[v + i, u + j] for i in (-1, 0, 1) for j in (-1, 0, 1)], 1).astype(float)
    patch[patch == 0] = np.nan
    known = np.isfinite(patch).sum(1) >= 5
    at, own, patch, descriptors = at[known], own[known], patch[known], descriptors[known]
    median = np.nanmedian(patch, 1) if len(patch) else np.zeros(0)
    smooth = np.nanmax(patch, 1) - np.nanmin(patch, 1) < 2 * JUMP * median if len(patch) else np.zeros(0, bool)
    rays = pixel_rays(frame, at)
    places = rays * median[:, None] + frame.pose[:3, 3]
    keep = smooth & in_box(places, box)
    at, own, rays, descriptors = at[keep], own[keep], rays[keep], descriptors[keep]
    places, normals, near = onto_surface(places[keep], rays, surface)
    # The feature's direction in the image, on the surface.
    beside = pixel_rays(frame, at + own[:, :2]) - rays
    along = (rays * normals).sum(1)
    way = beside - rays * ((beside * normals).sum(1) / np.where(np.abs(along) < 1e-3, 1e-3, along))[:, None]
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
    turns = np.stack([way, np.cross(normals, way), normals], 2)
    sizes = own[:, 2] * median[keep] / frame.camera[0, 0]
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9))
    return root[near], places[near], turns[near], sizes[near]


def onto_surface(places, rays, surface):
    """Places moved along their rays onto the fused surface, which has less noise than a frame's depth; its normals; whether it is near."""
    out = places.copy()
    reach = 2 * TRUNCATION * surface.volume.voxel_m
    for _ in range(3):
        off, at = surface.tree.query(out, distance_upper_bound=reach)
        near = np.flatnonzero(np.isfinite(off))
        p, n = surface.points[at[near]], surface.normals[at[near]]
        along = (rays[near] * n).sum(1)
        step = ((p - out[near]) * n).sum(1) / np.where(np.abs(along) < 0.2, np.inf, along)
        out[near] += rays[near] * np.clip(step, -reach, reach)[:, None]
    out = np.where((np.linalg.norm(out - places, axis=1) < reach)[:, None], out, places)
    off, at = surface.tree.query(out)
    return out, surface.normals[at], off < reach


@dataclass
class Matches:
    """Places in state 0 and in state 1, and the rotation between them that each match tells by itself."""

    p: np.ndarray
    q: np.ndarray
    turns: np.ndarray

    def __getitem__(self, index):
        return Matches(self.p[index], self.q[index], self.turns[index])

    def __len__(self):
        return len(self.p)

    def off(self, motion):
        """Distances under a motion; infinite where the match's own rotation is another."""
        trace = np.einsum("nij,ij->n", self.turns, motion[:3, :3])
        return np.where(trace > MIN_TRACE, np.linalg.norm(moved(motion, self.p) - self.q, axis=1), np.inf)


def matches_of(frames, surfaces, box):
    """Matches of features between the states, one for a pair of voxels."""
    seen = [[features(f, surface, box) for f in state] for state, surface in zip(frames, surfaces)]
    places, turns = [np.zeros((0, 6))], [np.zeros((0, 3, 3))]
    # A part that has turned looks the same from elsewhere, so every frame is tried with every one.
    for (own, p, first_turns, first_m), (other, q, second_turns, second_m) in itertools.product(*seen):
        if len(own) < 2 or len(other) < 2:
            continue
        # Descriptors have length 1.
        likeness = own @ other.T
        best = likeness.argmax(1)
        rows = np.arange(len(own))
        first = likeness[rows, best]
        mutual = likeness.argmax(0)[best] == rows
        likeness[rows, best] = -1
        far = np.sqrt(np.maximum(2 - 2 * likeness.max(1), 0))
        keep = mutual & (np.sqrt(np.maximum(2 - 2 * first, 0)) < RATIO * far)
        # A feature is as large on the object in both states.
        keep &= np.abs(np.log(first_m / second_m[best])) < np.log(SIZE)
        places.append(np.hstack([p[keep], q[best[keep]]]))
        turns.append(second_turns[best[keep]] @ first_turns[keep].transpose(0, 2, 1))
    places, turns = np.concatenate(places), np.concatenate(turns)
    _, at = np.unique(np.rint(places / surfaces[0].volume.voxel_m).astype(int), axis=0, return_index=True)
    return Matches(places[at, :3], places[at, 3:], turns[at])


def observed(recording):
    """Surfaces and matches of a recording, its box and whether it is the user's."""
    box, given = workspace(recording)
    frames = [frames_of(recording / f"state{k}") for k in (0, 1)]
    surfaces = [Surface(f, box, (box[1] - box[0]).max() / VOXELS) for f in frames]
    return box, given, surfaces, matches_of(frames, surfaces, box)
