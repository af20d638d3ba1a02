"""Labels of the surface points of both states by motion, in turn with a choice and a refinement of the motions."""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from .motions import REACH, SLACK, cell_support
from .rigid_motion import differ, moved

# Rounds of labels and refinement, neighbors of a point, rounds of averaging over them.
ROUNDS, NEIGHBORS, SMOOTHINGS = 10, 12, 3
# Costs of a label: distance that costs 1, units, at first and at last; on top for each motion but the static one.
CAPS, MOVING = (4.0, 2.0), 0.05
# Cosine between normals that belong together.
AGREE = 0.7
# A motion's worth: how much more the points would cost without it, and a factor times the share of the cells of matches that follow no
# other, where it costs less by so much. The least worth by which it is kept; two motions are one where they differ by less, units.
MATCH_WORTH, CLEAR, MIN_WORTH, SAME = 0.5, 0.05, 0.01, 3.0
# A match's weight in the refinement; a point's is 1.
MATCH_WEIGHT = 0.3


def label_costs(points, normals, motions, surface, cap_m):
    """Cost of every point under every motion: distance to the other state's surface, capped; unseen places cost less than free ones."""
    out = []
    for k, motion in enumerate(motions):
        there, turned = moved(motion, points), normals @ motion[:3, :3].T
        off, at = surface.tree.query(there, k=4, distance_upper_bound=2 * cap_m, workers=2)
        hit = np.isfinite(off)
        at = np.where(hit, at, 0)
        agree = np.einsum("pki,pi->pk", surface.normals[at], turned)
        plane = np.abs(np.einsum("pki,pki->pk", there[:, None] - surface.points[at], surface.normals[at]))
        side = np.sqrt(np.maximum(np.where(hit, off, 0) ** 2 - plane**2, 0))
        # A point off the rim of a surface is not on it.
        costs = np.where(hit & (agree > AGREE), plane / cap_m + np.maximum(side - 2 * surface.volume.voxel_m, 0) / cap_m, np.inf).min(1)
        out.append(np.minimum(costs, surface.volume.free(there)) + (MOVING if k else 0))
    return np.stack(out, 1)


def averaged(costs, near):
    """Costs averaged over neighbors."""
    for _ in range(SMOOTHINGS):
        costs = costs[near].mean(1)
    return costs


def tukey(rest, least, most):
    """Weights by Tukey's biweight, scaled by the spread of what is there within limits."""
    scale = np.clip(4.7 * 1.4826 * np.median(np.abs(rest)), least, most) if len(rest) else least
    return np.maximum(1 - (rest / scale) ** 2, 0) ** 2


def refined(motion, sides, matches, cap_m):
    """A motion by robust point to plane, with matches. A side: points and normals, the other state's surface, whether it is of state 0."""
    for _ in range(6):
        rows, rest, weights = [], [], []
        inverse = np.linalg.inv(motion)
        for points, surface, first in sides:
            there = moved(motion if first else inverse, points[0])
            turned = points[1] @ (motion if first else inverse)[:3, :3].T
            off, at = surface.tree.query(there, distance_upper_bound=2 * cap_m, workers=2)
            hit = np.isfinite(off)
            hit[hit] &= (turned[hit] * surface.normals[at[hit]]).sum(1) > AGREE
            a, b = there[hit], surface.points[at[hit]]
            n = surface.normals[at[hit]]
            if not first:
                # The plane is at the point of state 0, which moves.
                a, b, n = moved(motion, b), points[0][hit], n @ motion[:3, :3].T
            rows.append(np.hstack([np.cross(a, n), n]))
            rest.append(((b - a) * n).sum(1))
            weights.append(tukey(rest[-1], 0.25 * cap_m, cap_m))
        p, q = matches.p, matches.q
        if len(p):
            there = moved(motion, p)
            off = np.linalg.norm(q - there, axis=1)
            weight = MATCH_WEIGHT * tukey(off, 0.5 * cap_m, 2 * cap_m)
            for axis in np.eye(3):
                rows.append(np.hstack([np.cross(there, axis), np.tile(axis, (len(p), 1))]))
                rest.append((q - there) @ axis)
                weights.append(weight)
        rows, rest, weights = np.concatenate(rows), np.concatenate(rest), np.concatenate(weights)
        if (weights > 0).sum() < 50:
            return motion
        normal = rows.T @ (weights[:, None] * rows)
        normal += np.diag(1e-6 * np.diag(normal).max() * np.ones(6))
        step = np.linalg.solve(normal, rows.T @ (weights * rest))
        turn = np.eye(4)
        turn[:3, :3], turn[:3, 3] = Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]
        motion = turn @ motion
    return motion


def kept_motions(motions, points, costs, follows, ends, support, unit_m):
    """Indices of the motions that explain what no other does and that move their points. The static one is first.

    `follows` holds which matches follow which motion, a motion that was found earlier has more of them; `ends` their nearest points of both
    states. A match is worth nothing where an earlier motion brings the surface there as well: texture repeats itself.
    """
    kept = list(range(len(motions)))
    while len(kept) > 1:
        labels = [c[:, kept].argmin(1) for c in costs]
        cells = max(int(support(follows[:, kept].any(1)[None])[0]), 1) if len(follows) else 1
        worth = []
        for at, k in enumerate(kept[1:], 1):
            rest = [o for o in kept if o != k]
            gain = sum((c[:, rest].min(1) - c[:, kept].min(1)).mean() for c in costs) / 2
            own = points[0][0][labels[0] == at]
            own = own if len(own) else moved(np.linalg.inv(motions[k]), points[1][0][labels[1] == at])
            if any(differ(motions[k], motions[o], own) < (SAME if o else SLACK) * unit_m for o in rest if o < k):
                gain = -1.0
            elif len(follows):
                moving = np.all([(c[:, k] + CLEAR < c[:, kept[:at]].min(1))[e] for c, e in zip(costs, ends)], axis=0)
                gain += MATCH_WORTH * int(support((moving & follows[:, k] & ~follows[:, rest].any(1))[None])[0]) / cells
            worth.append((gain, k))
        least, k = min(worth)
        if least >= MIN_WORTH:
            break
        kept.remove(k)
    return kept


def alternate(motions, surfaces, matches, unit_m, rng):
    """Labels and refinement in turn; the motions that are left, the points and labels of both states."""
    picks = [s.sample(rng) for s in surfaces]
    points = [(s.points[i], s.normals[i]) for s, i in zip(surfaces, picks)]
    near = [cKDTree(x).query(x, k=NEIGHBORS, workers=2)[1] for x, _ in points]
    support = cell_support(matches.p, REACH * unit_m)
    ends = [cKDTree(x).query(at, workers=2)[1] for (x, _), at in zip(points, (matches.p, matches.q))]
    for turn in range(ROUNDS + 1):
        cap_m = unit_m * max(CAPS[1], CAPS[0] - (CAPS[0] - CAPS[1]) * turn / (0.5 * ROUNDS))
        ways = [motions, [np.linalg.inv(m) for m in motions]]
        costs = [averaged(label_costs(*points[k], ways[k], surfaces[1 - k], cap_m), near[k]) for k in (0, 1)]
        off = np.stack([matches.off(m) for m in motions], 1)
        kept = kept_motions(motions, points, costs, off < REACH * unit_m, ends, support, unit_m)
        motions, labels = [motions[k] for k in kept], [c[:, kept].argmin(1) for c in costs]
        if turn == ROUNDS:
            return motions, points, labels
        off = off[:, kept]
        own = np.where(off.min(1) < REACH * unit_m, off.argmin(1), -1)
        motions = [
            refined(motion, [([x[labels[s] == k] for x in points[s]], surfaces[1 - s], s == 0) for s in (0, 1)], matches[own == k], cap_m)
            for k, motion in enumerate(motions)
        ]
