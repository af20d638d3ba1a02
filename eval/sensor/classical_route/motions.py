"""The static motion and further ones between the states, by sequential RANSAC over matches."""

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from .matches import MIN_TRACE
from .rigid_motion import differ, rigid, turn_deg

# Errors of a recording: a unit is the median distance of matches that follow the static motion, within these bounds, voxels.
LEAST_UNIT, MOST_UNIT = 1.0, 2.5
# Distance within which a match follows a motion, units.
REACH = 2.5
# The static motion is within this of the identity: rotation, degrees; displacement at the middle of the box, share of its size.
STATIC_DEG, STATIC_SHARE = 3.0, 0.05
# Hypotheses of a motion; cells (three units wide) that must hold matches of one; most motions.
HYPOTHESES, MIN_CELLS, MAX_MOTIONS = 6000, 10, 10
# Matches that start hypotheses, neighbors of one that are looked at, hypotheses tried with one.
SEEDS, SEED_NEIGHBORS, SEED_TRIPLES = 4000, 200, 6
# Inliers of a motion moved by less than this: slack of the static part, not a motion. Units.
SLACK = 4.0


def triples(matches, reach, rng):
    """Indices of three matches near each other with equal lengths in both states, and about the same rotation."""
    p, q = matches.p, matches.q
    # One match a cell of both states as a neighbor; a cell of many matches starts no more often than one of few.
    order = rng.permutation(len(p))
    _, at = np.unique(np.floor(np.hstack([p, q])[order] / (0.5 * reach)).astype(int), axis=0, return_index=True)
    others = order[np.sort(at)]
    _, cell, count = np.unique(np.floor(p / (1.2 * reach)).astype(int), axis=0, return_inverse=True, return_counts=True)
    share = 1 / count[cell.ravel()]
    first = rng.choice(len(p), SEEDS, p=share / share.sum())
    size = min(len(others), SEED_NEIGHBORS)
    near = others[cKDTree(p[others]).query(p[first], k=size)[1].reshape(len(first), size)]
    long = np.linalg.norm(p[near] - p[first][:, None], axis=2)
    agree = (long > 2 * reach) & (np.abs(long - np.linalg.norm(q[near] - q[first][:, None], axis=2)) < 0.7 * reach)
    agree &= np.einsum("skij,sij->sk", matches.turns[near], matches.turns[first]) > MIN_TRACE
    # Neighbors that agree with the first match come first, in a random order.
    order = np.argsort(np.where(agree, rng.random(agree.shape), 2), axis=1)[:, : 2 * SEED_TRIPLES]
    half = order.shape[1] // 2
    near, agree = np.take_along_axis(near, order, 1), np.take_along_axis(agree, order, 1)
    three = np.stack([np.repeat(first[:, None], half, 1), near[:, :half], near[:, half : 2 * half]], 2)
    three = three[agree[:, :half] & agree[:, half : 2 * half]]
    a, b, c = three.T
    long = np.linalg.norm(p[b] - p[c], axis=1)
    good = (long > 2 * reach) & (np.abs(long - np.linalg.norm(q[b] - q[c], axis=1)) < 0.7 * reach)
    good &= np.linalg.norm(np.cross(p[b] - p[a], p[c] - p[a]), axis=1) > 2 * reach**2
    three = three[good]
    return three[rng.permutation(len(three))[:HYPOTHESES]]


def cell_support(p, reach):
    """A function that counts the cells (three units wide) of the matches in each row of a table of truths."""
    _, cell = np.unique(np.floor(p / (3 / REACH * reach)).astype(int), axis=0, return_inverse=True)
    cells = sparse.csr_matrix((np.ones(len(p)), (np.arange(len(p)), cell.ravel())))
    return lambda inside: np.asarray(((sparse.csr_matrix(inside) @ cells) > 0).sum(1)).ravel()


def best_motion(matches, reach, rng, allowed=lambda motions: np.ones(len(motions), bool)):
    """The motion that matches in the most cells follow, which matches follow it, and the number of their cells."""
    if len(matches) < 6:
        return None
    index = triples(matches, reach, rng)
    motions = rigid(matches.p[index], matches.q[index])
    motions = motions[allowed(motions)]
    if not len(motions):
        return None
    support, flat = cell_support(matches.p, reach), matches.turns.reshape(-1, 9)
    step, counts = max(1, 2_000_000 // len(matches)), []
    for k in range(0, len(motions), step):
        some = motions[k : k + step]
        there = np.einsum("hij,nj->hni", some[:, :3, :3], matches.p) + some[:, None, :3, 3]
        near = ((there - matches.q) ** 2).sum(-1) < reach**2
        counts.append(support(near & (some[:, :3, :3].reshape(-1, 9) @ flat.T > MIN_TRACE)))
    best = None
    for k in np.argsort(-np.concatenate(counts), kind="stable")[:30]:
        motion = motions[k]
        for _ in range(5):
            inside = matches.off(motion) < reach
            if inside.sum() < 3:
                break
            motion = rigid(matches.p[inside], matches.q[inside])
        inside = matches.off(motion) < reach
        count = int(support(inside[None])[0])
        if allowed(motion[None])[0] and (best is None or count > best[2]):
            best = motion, inside, count
    return best


def found_motions(matches, box, voxel_m, rng):
    """The static motion, then further ones by sequential RANSAC; and the unit of this recording's errors, meters."""
    middle, size = box.mean(0), (box[1] - box[0]).max()

    def still(motions):
        slide = np.linalg.norm(motions[:, :3, :3] @ middle + motions[:, :3, 3] - middle, axis=1)
        return (turn_deg(motions[:, :3, :3]) < STATIC_DEG) & (slide < STATIC_SHARE * size)

    near = matches[matches.off(np.eye(4)) < STATIC_SHARE * size + 0.5 * size * np.radians(STATIC_DEG)]
    static, unit_m = np.eye(4), voxel_m
    for _ in range(2):
        best = best_motion(near, REACH * unit_m, rng, still)
        if best is not None and best[2] >= MIN_CELLS:
            static = best[0]
        off = matches.off(static)
        off = off[off < 2 * REACH * voxel_m]
        unit_m = np.clip(np.median(off), LEAST_UNIT * voxel_m, MOST_UNIT * voxel_m) if len(off) else voxel_m
    motions, reach = [static], REACH * unit_m
    left = matches[matches.off(static) > 1.5 * reach]
    while len(motions) < MAX_MOTIONS:
        best = best_motion(left, reach, rng)
        if best is None or best[2] < MIN_CELLS:
            break
        motion, inside, _ = best
        if differ(motion, static, left.p[inside]) > SLACK * unit_m:
            motions.append(motion)
        left = left[left.off(motion) > 1.5 * reach]
    return motions, unit_m
