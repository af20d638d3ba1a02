"""Where a two-finger hand can hold, hook or push a part, found from the collision solids of the twin alone.

The twin is looked at along a few directions, as maps of depth. A grasp is a place where something narrow of the part
stands between two slots that fingers fit into; a hook is one slot with the part ahead of it; a push is a flat patch of
the part that faces the hand. All are checked with the hand's boxes along the whole way, and given best first.
"""
from dataclasses import dataclass

import numpy as np

from twin import below, planes, solids, vertices

# Way of approach before a hold and of retreat after it, m.
APPROACH = 0.08
# Least room between a finger and what it must not touch, m.
ROOM = 0.003
# Depths of a part's front behind the fingertips between which a grasp is tried, m.
SHALLOW, DEEP = 0.006, 0.035
# Depth behind the foremost place of a part over which the worth of a handle fades, m.
HANDLE = 0.015
# Cosine between a face and the pads below which rubber of friction 1 hardly holds: 0.71 is the limit.
SLIPS = 0.75
# Behind the fingertips: where a pad meets the part, m.
PAD = 0.008
# Depth to which a map's patch counts as flat, m.
FLAT = 0.003
# Most candidates of a kind and direction.
EACH = 8
# Widest map, cells; finest cell, m.
CELLS, FINEST = 150, 0.003


@dataclass
class Hand:
    """Boxes of a hand, m: fingers with their widest gap, thickness along the closing direction, width, length; the
    palm behind them: half sizes along the closing direction, across it and along the approach."""

    gap: float
    thick: float
    wide: float
    long: float
    palm: tuple


@dataclass
class Hold:
    """A hand's pose: the columns of `rotation` are closing direction, across, approach; `tip` is between the
    fingertips. `gap` is how far the fingers are apart on the way in: 0 for hooks and pushes."""

    kind: str
    rotation: np.ndarray
    tip: np.ndarray
    gap: float
    score: float
    front: np.ndarray
    stance: object = None

    def carried(self, motion):
        rotation, translation = motion
        return rotation @ self.rotation, rotation @ self.tip + translation

    def before(self, pose, by=APPROACH):
        rotation, tip = pose
        return rotation, tip - by * rotation[:, 2]


class Scene:
    """A twin at rest, seen from outside: solids of a moving part and of all else."""

    def __init__(self, model, data, joint, but=frozenset()):
        """`but`: geoms that are no part of it."""
        self.model, self.data, self.joint = model, data, joint
        self.bodies = below(model, model.body(joint.body).id)
        inside, outside = [], []
        for body in range(model.nbody):
            for g in solids(model, body):
                if g not in but:
                    (inside if body in self.bodies else outside).append(self._solid(g))
        self.part, self.others = inside, outside
        points = np.concatenate([corners for _, _, corners, _ in inside])
        self.points, self.middle = points, (points.min(0) + points.max(0)) / 2
        j = model.joint(joint.name).id
        self.axis, self.anchor = data.xaxis[j].copy(), data.xanchor[j].copy()
        self.axes = self.directions()
        self.reach = max(np.linalg.norm(self.away(p)) for p in points) if joint.kind != "slide" else 1.0

    def _solid(self, geom):
        normals, offsets, areas = planes(self.model, self.data, geom)
        return normals, offsets, vertices(self.model, self.data, geom), areas

    def away(self, point):
        """The joint's axis to a point, square to the axis."""
        d = point - self.anchor
        return d - self.axis * (d @ self.axis)

    def way(self, point, sign):
        """Unit direction in which a point of the part moves with the joint."""
        if self.joint.kind == "slide":
            return sign * self.axis
        d = sign * np.cross(self.axis, point - self.anchor)
        if self.joint.kind == "screw":
            d = d + sign * self.joint.pitch * self.axis
        return d / max(np.linalg.norm(d), 1e-9)

    def ahead(self, point):
        """How far the part reaches beyond a point, in the direction in which that opens, m."""
        way = self.way(point, np.sign(self.joint.open - self.joint.closed))
        # Square to the part's face, where that is nearly its way.
        face = max(self.axes, key=lambda a: abs(a @ way))
        return max(0.0, float(((self.points - point) @ face).max() if face @ way > 0 else ((point - self.points) @ face).max()))

    def lever(self, point):
        """A share: 1 where the part reaches farthest from its axis."""
        return 1.0 if self.joint.kind == "slide" else float(np.linalg.norm(self.away(point)) / self.reach)

    def directions(self):
        """Directions to look along: the joint's, and two square to it that the part's faces have."""
        a = self.axis
        u = np.array([0.0, 0, 1]) if abs(a[2]) < 0.9 else np.array([1.0, 0, 0])
        u -= a * (a @ u)
        u /= np.linalg.norm(u)
        v = np.cross(a, u)
        if self.joint.kind == "slide":
            return [a, u, v]
        # Square to most of its surface.
        normals = np.concatenate([n for n, _, _, _ in self.part]) @ np.stack([u, v], 1)
        areas = np.concatenate([w for _, _, _, w in self.part])
        angles = np.radians(np.arange(0, 90, 1.0))
        square = [areas @ ((normals @ [np.cos(t), np.sin(t)]) ** 8 + (normals @ [-np.sin(t), np.cos(t)]) ** 8) for t in angles]
        t = angles[int(np.argmax(square))]
        return [a, np.cos(t) * u + np.sin(t) * v, np.cos(t) * v - np.sin(t) * u]


class Map:
    """Depth along a direction over a grid: of the part, and of all else. Infinite where nothing is."""

    def __init__(self, scene, rotation, hand):
        self.rotation = rotation
        flat = scene.points @ rotation
        pad = hand.thick + hand.gap + 0.01
        self.low, high = flat.min(0) - pad, flat.max(0) + pad
        self.low[2] += pad
        self.cell = max(FINEST, float((high - self.low)[:2].max()) / CELLS)
        self.shape = tuple(int(n) for n in np.ceil((high - self.low)[:2] / self.cell))
        self.part, self.other = self._depth(scene.part), self._depth(scene.others)

    def _depth(self, group):
        depth = np.full(self.shape, np.inf)
        for normals, offsets, corners, _ in group:
            flat = corners @ self.rotation
            first = np.maximum(np.floor((flat.min(0)[:2] - self.low[:2]) / self.cell).astype(int), 0)
            last = np.minimum(np.ceil((flat.max(0)[:2] - self.low[:2]) / self.cell).astype(int) + 1, self.shape)
            if (last <= first).any():
                continue
            u, v = (self.low[k] + (np.arange(first[k], last[k]) + 0.5) * self.cell for k in (0, 1))
            n = normals @ self.rotation
            enter, leave = np.full((len(u), len(v)), -np.inf), np.full((len(u), len(v)), np.inf)
            for (x, y, z), d in zip(n, offsets):
                room = d - x * u[:, None] - y * v[None, :]
                if z < -1e-9:
                    np.maximum(enter, room / z, out=enter)
                elif z > 1e-9:
                    np.minimum(leave, room / z, out=leave)
                else:
                    enter[room < 0] = np.inf
            enter[enter > leave] = np.inf
            part = depth[first[0] : last[0], first[1] : last[1]]
            np.minimum(part, enter, out=part)
        return depth

    def point(self, i, k, depth):
        return self.rotation @ np.array([*(self.low[:2] + (np.array([i, k]) + 0.5) * self.cell), depth])

    def cells(self, length):
        """Cells that cover a length, odd."""
        return 2 * int(np.ceil(length / self.cell / 2)) + 1


def counted(mask, wide, high):
    """How many cells of a mask lie in the box of odd size about each cell; outside there is nothing."""
    a, b = wide // 2, high // 2
    padded = np.pad(mask.astype(np.int32), ((a + 1, a), (b + 1, b)))
    s = padded.cumsum(0).cumsum(1)
    return s[wide:, high:] - s[:-wide, high:] - s[wide:, :-high] + s[:-wide, :-high]


def shifted(values, by, fill):
    """`values` at the cell that is `by` farther along the first axis."""
    out = np.full_like(values, fill)
    if by >= 0:
        out[: len(out) - by] = values[by:]
    else:
        out[-by:] = values[:by]
    return out


def best(scores, count, apart):
    """Indices of the largest scores, no two within `apart` cells."""
    scores, found = scores.copy(), []
    for _ in range(count):
        i, k = np.unravel_index(int(np.argmax(scores)), scores.shape)
        if not np.isfinite(scores[i, k]):
            break
        found.append((int(i), int(k), float(scores[i, k])))
        scores[max(i - apart, 0) : i + apart + 1, max(k - apart, 0) : k + apart + 1] = -np.inf
    return found


def levels(map_):
    """Depths for fingertips: 8 to 26 mm behind the fronts of the part, 6 mm apart."""
    tops = map_.part[np.isfinite(map_.part) & (map_.part <= map_.other)]
    if not len(tops):
        return []
    steps = np.unique(np.round((tops + 0.014) / 0.006).astype(int))
    return np.unique(np.concatenate([steps + k for k in (-1, 0, 1, 2)])) * 0.006


def grasps(scene, map_, hand, sign):
    """Narrow things of the part between two slots."""
    c = map_.rotation[:, 0]
    finger, wide = map_.cells(hand.thick + 2 * ROOM), map_.cells(hand.wide + 2 * ROOM)
    rows = map_.cells(hand.wide)
    lever, along = _fields(scene, map_, sign, c)
    score = np.full(map_.shape, -np.inf)
    picked = np.zeros((*map_.shape, 2))
    # Narrow gaps first: the first that fits is the part's width there.
    gaps = np.arange(0.006, hand.gap - 2 * ROOM + 1e-9, max(0.004, map_.cell))
    for level in levels(map_):
        front = (map_.part < level - SHALLOW) & (map_.part > level - DEEP) & (map_.part <= map_.other)
        if not front.any():
            continue
        free = counted((map_.part < level) | (map_.other < level), finger, wide) == 0
        depth = np.where(front, level - map_.part, 0)
        open_ = np.ones(map_.shape, bool)
        for gap in gaps:
            off = int(round((gap / 2 + hand.thick / 2 + ROOM) / map_.cell))
            across = map_.cells(gap)
            fits = open_ & shifted(free, off, True) & shifted(free, -off, True) & front
            if not fits.any():
                continue
            fits &= counted(map_.other < level, across, rows) == 0
            touch = counted(front, across, rows) / (across * rows)
            fits &= touch > 0.2
            value = lever + 0.3 * np.abs(along) + 0.6 * touch + 0.5 * np.minimum(depth / 0.025, 1) - 12 * gap
            better = fits & (value > score)
            score[better] = value[better]
            picked[better] = [level, gap]
            open_ &= ~fits
    found = []
    for i, k, s in best(score, EACH, max(3, int(0.02 / map_.cell))):
        level, gap = picked[i, k]
        width = min(gap + 4 * ROOM, hand.gap)
        found.append(Hold("grasp", map_.rotation, map_.point(i, k, level), width, s, map_.point(i, k, map_.part[i, k])))
    return found


def _fields(scene, map_, sign, direction):
    """Per cell: the lever, and how far the way there runs along a direction (-1 to 1)."""
    n, m = map_.shape
    step = max(1, n // 30, m // 30)
    lever, along = np.zeros((n, m)), np.zeros((n, m))
    for i in range(0, n, step):
        for k in range(0, m, step):
            d = map_.part[i, k]
            p = map_.point(i, k, d if np.isfinite(d) else map_.low[2])
            lever[i : i + step, k : k + step] = scene.lever(p)
            along[i : i + step, k : k + step] = scene.way(p, sign) @ direction
    return lever, along


def hooks(scene, map_, hand, sign):
    """Slots with the part ahead of them, in the direction that it is to go."""
    c = map_.rotation[:, 0]
    both, wide = map_.cells(2 * hand.thick + 2 * ROOM), map_.cells(hand.wide + 2 * ROOM)
    lever, along = _fields(scene, map_, sign, c)
    off = int(round((hand.thick + ROOM + 0.006) / map_.cell))
    box = map_.cells(0.008), map_.cells(hand.wide)
    score, picked = np.full(map_.shape, -np.inf), np.zeros(map_.shape)
    for level in levels(map_):
        front = (map_.part < level - SHALLOW) & (map_.part > level - DEEP) & (map_.part <= map_.other)
        free = counted((map_.part < level) | (map_.other < level), both, wide) == 0
        there = counted(front, *box) / (box[0] * box[1])
        for ahead in (1, -1):
            touch = shifted(there, ahead * off, 0)
            value = lever + 0.4 * ahead * along + 0.4 * touch - 0.3
            better = free & (touch > 0.5) & (ahead * along > 0.9) & (value > score)
            score[better], picked[better] = value[better], level
    found = best(score, EACH, max(3, int(0.03 / map_.cell)))
    tips = ((map_.point(i, k, picked[i, k]), s) for i, k, s in found)
    return [Hold("hook", map_.rotation, tip, 0.0, s, tip) for tip, s in tips]


def pushes(scene, map_, hand, sign):
    """Flat patches of the part that face the hand, which comes the way that the part is to go."""
    a = map_.rotation[:, 2]
    wide, high = map_.cells(2 * hand.thick + 0.006), map_.cells(hand.wide + 0.006)
    lever, along = _fields(scene, map_, sign, a)
    mine = np.isfinite(map_.part) & (map_.part < map_.other)
    whole = counted(mine, wide, high) == wide * high
    depth = np.where(mine, map_.part, 0)
    mean = counted_sum(depth, wide, high) / (wide * high)
    flat = np.abs(depth - mean) < FLAT
    flat &= counted(flat, wide, high) == wide * high
    fits = whole & flat & (along > 0.85)
    centre = np.indices(map_.shape).transpose(1, 2, 0) - np.array(map_.shape) / 2
    off = np.linalg.norm(centre, axis=2) / (max(map_.shape) / 2)
    if scene.joint.kind == "slide":
        value = 1 - 0.5 * off
    else:
        value = np.minimum(lever, 0.85) - 0.1 * off
    score = np.where(fits, value + 0.5 * along, -np.inf)
    found = best(score, EACH, max(3, int(0.04 / map_.cell)))
    tips = ((map_.point(i, k, map_.part[i, k]), s) for i, k, s in found)
    return [Hold("push", map_.rotation, tip, 0.0, s, tip) for tip, s in tips]


def counted_sum(values, wide, high):
    a, b = wide // 2, high // 2
    s = np.pad(values, ((a + 1, a), (b + 1, b))).cumsum(0).cumsum(1)
    return s[wide:, high:] - s[:-wide, high:] - s[wide:, :-high] + s[:-wide, :-high]


def frames(scene):
    """Rotations of a hand: closing direction, across, approach."""
    for first in range(3):
        closings = [scene.axes[k] for k in range(3) if k != first]
        if first == 0 and scene.joint.kind != "slide":  # a part that turns goes every way
            turns = np.radians(np.arange(0, 180, 22.5))
            closings = [np.cos(t) * closings[0] + np.sin(t) * closings[1] for t in turns]
        for approach in (scene.axes[first], -scene.axes[first]):
            for closing in closings:
                yield np.stack([closing, np.cross(approach, closing), approach], 1)


def candidates(scene, hand, sign):
    """Holds that may move the part in a direction of its joint, best first, not yet checked."""
    found = []
    for rotation in frames(scene):
        map_ = Map(scene, rotation, hand)
        found += grasps(scene, map_, hand, sign) + hooks(scene, map_, hand, sign) + pushes(scene, map_, hand, sign)
    for hold in found:
        # From below there is a floor or a table. What stands out of a front, in the way that it opens, is a handle.
        hold.score -= 0.5 * max(0.0, hold.rotation[2, 2])
        hold.score += 1.4 * np.exp(-scene.ahead(hold.front) / HANDLE)
        # Fingers slip off faces that are not square to them.
        if hold.kind == "grasp":
            square = squareness(scene, hold)
            hold.score -= 1 - square + (2 if square < SLIPS else 0)
    return sorted(found, key=lambda h: -h.score)


def squareness(scene, hold):
    """How square the part's faces stand to the way that the fingers close, the worse of both sides: a cosine."""
    closing, found = hold.rotation[:, 0], []
    for side in (1, -1):
        start = hold.tip - PAD * hold.rotation[:, 2] + side * hold.gap / 2 * closing
        hits = [hit for solid in scene.part if (hit := first_face(solid, start, -side * closing))]
        if not hits:
            return 0.0
        found.append(abs(float(min(hits, key=lambda h: h[0])[1] @ closing)))
    return min(found)


def first_face(solid, start, way):
    """Where a ray meets a convex solid from outside: distance and normal; or `None`."""
    normals, offsets, _, _ = solid
    toward, room = normals @ way, offsets - normals @ start
    if ((np.abs(toward) < 1e-9) & (room < 0)).any():
        return None
    enters, leaves = toward < -1e-9, toward > 1e-9
    at = np.where(enters, room / np.where(enters, toward, 1), -np.inf)
    until = np.where(leaves, room / np.where(leaves, toward, 1), np.inf).min()
    k = int(np.argmax(at))
    return (float(at[k]), normals[k]) if 0 <= at[k] <= until else None


def near(hold, other):
    """Whether two holds are hardly different."""
    same = hold.kind == other.kind and np.allclose(hold.rotation, other.rotation, atol=0.2)
    return same and np.linalg.norm(hold.tip - other.tip) < 0.015
