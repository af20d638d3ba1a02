"""Truncated signed distances fused from the frames of a state, and their surface."""

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from .recording import Frame, in_box, lifted

# Truncation, voxels; views that must have seen a surface.
TRUNCATION, MIN_VIEWS = 4, 2
# Depth is left out within two pixels of a jump by this share of the range, and where the surface is seen at less than this cosine.
JUMP, MIN_COSINE = 0.015, 0.2
# Smallest piece of a surface, share of its points.
MIN_PIECE = 0.004
# Cost of a label where the place was never seen.
UNSEEN = 0.5
# Surface points of a state that are labeled.
POINTS = 25_000


def depth_weights(frame):
    """Weight of every pixel's depth, 0 where it is not used: at jumps, at grazing surfaces, and far away."""
    depth = frame.depth_m
    near = np.where(depth > 0, depth, np.inf).astype(np.float32)
    low = cv2.erode(near, np.ones((3, 3)))
    high = cv2.dilate(depth, np.ones((3, 3)))
    jump = (depth > 0) & (high - low > JUMP * depth * 2)
    used = (depth > 0) & ~cv2.dilate(jump.astype(np.uint8), np.ones((3, 3))).astype(bool)
    smooth = Frame(frame.color, cv2.GaussianBlur(depth, (0, 0), 1.5), frame.camera, frame.pose)
    points = lifted(smooth)
    across, down = np.zeros_like(points), np.zeros_like(points)
    across[:, 2:-2] = points[:, 4:] - points[:, :-4]
    down[2:-2] = points[4:] - points[:-4]
    normal = np.cross(across, down)
    length = np.linalg.norm(normal, axis=-1) * np.linalg.norm(points, axis=-1)
    cosine = np.abs((normal * points).sum(-1)) / np.maximum(length, 1e-12)
    used &= cosine > MIN_COSINE
    # Stereo: the deviation of a depth grows with its square.
    return np.where(used, cosine / np.maximum(depth, 0.1) ** 4, 0).astype(np.float32)


class Volume:
    """Truncated signed distances in a box, in truncations; outside is positive."""

    def __init__(self, frames, box, voxel_m):
        self.voxel_m, self.lower = voxel_m, box[0]
        shape = np.ceil((box[1] - box[0]) / voxel_m).astype(int) + 1
        self.value, self.weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        self.views = np.zeros(shape, np.uint8)
        for frame in frames:
            self.add(frame)
        self.value /= np.maximum(self.weight, 1e-20)

    def add(self, frame):
        weights = depth_weights(frame)
        world_from = frame.pose
        start = (self.lower - world_from[:3, 3]) @ world_from[:3, :3]
        steps = [world_from[a, :3] * self.voxel_m for a in range(3)]
        # A slab of the volume at a time, to stay in the cache.
        slab = max(1, 200_000 // (self.value.shape[1] * self.value.shape[2]))
        for i in range(0, self.value.shape[0], slab):
            part = slice(i, min(i + slab, self.value.shape[0]))
            ranges = [np.arange(part.start, part.stop), *(np.arange(n) for n in self.value.shape[1:])]
            along = [np.ix_(*((r * s[a]).astype(np.float32) for r, s in zip(ranges, steps))) for a in range(3)]
            x, y, z = (sum(parts) + np.float32(start[a]) for a, parts in enumerate(along))
            h, w = frame.depth_m.shape
            with np.errstate(divide="ignore", invalid="ignore"):
                u = x / z * np.float32(frame.camera[0, 0]) + np.float32(frame.camera[0, 2] + 0.5)
                v = y / z * np.float32(frame.camera[1, 1]) + np.float32(frame.camera[1, 2] + 0.5)
                inside = (z > 0.05) & (u >= 0) & (u < w) & (v >= 0) & (v < h)
            at = np.where(inside, v, 0).astype(np.int32) * w + np.where(inside, u, 0).astype(np.int32)
            weight = np.where(inside, weights.ravel()[at], 0)
            distance = (frame.depth_m.ravel()[at] - z) / np.float32(TRUNCATION * self.voxel_m)
            weight[distance < -1] = 0
            near = (weight > 0) & (distance < 1)
            self.value[part] += weight * np.minimum(distance, 1)
            self.weight[part] += weight
            self.views[part] += near

    def free(self, points):
        """For each point: 1 where it stands in space seen free, 0 near a surface, UNSEEN where nothing is known."""
        at = np.rint((points - self.lower) / self.voxel_m).astype(int)
        inside = ((at >= 0) & (at < self.value.shape)).all(1)
        i, j, k = np.where(inside[:, None], at, 0).T
        seen = inside & (self.weight[i, j, k] > 0)
        return np.where(seen, np.where(self.value[i, j, k] > 0.3, 1.0, UNSEEN), UNSEEN)


class Surface:
    """Points and normals of a volume's surface."""

    def __init__(self, frames, box, voxel_m):
        self.volume = Volume(frames, box, voxel_m)
        points, outward = self.crossings()
        keep = in_box(points, box)
        points, outward = points[keep], outward[keep]
        keep = large_pieces(points, voxel_m)
        self.points, outward = points[keep], outward[keep]
        if len(self.points) < 500:
            raise ValueError("hardly any surface in the box")
        self.tree = cKDTree(self.points)
        self.normals = self.fitted_normals(outward)

    def crossings(self):
        """Where the distance changes its sign along an axis of the volume, one point a voxel, and the way outward."""
        volume = self.volume
        seen = (volume.weight > 0) & (volume.views >= MIN_VIEWS)
        points, outward = [], []
        for axis in range(3):
            first = tuple(slice(None, -1) if a == axis else slice(None) for a in range(3))
            second = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
            a, b = volume.value[first], volume.value[second]
            hit = seen[first] & seen[second] & ((a > 0) != (b > 0)) & (np.abs(a) < 0.95) & (np.abs(b) < 0.95) & (np.abs(a - b) < 1)
            at = np.argwhere(hit).astype(float)
            share = a[hit] / (a[hit] - b[hit])
            at[:, axis] += share
            way = np.zeros_like(at)
            way[:, axis] = b[hit] - a[hit]
            points.append(at)
            outward.append(way)
        points, outward = np.concatenate(points), np.concatenate(outward)
        _, cell = np.unique(np.rint(points).astype(int), axis=0, return_inverse=True)
        return volume.lower + volume.voxel_m * means(points, cell), means(outward, cell)

    def fitted_normals(self, outward):
        _, near = self.tree.query(self.points, k=min(24, len(self.points)), workers=2)
        offsets = self.points[near] - self.points[near].mean(1, keepdims=True)
        normals = np.linalg.eigh(np.einsum("pki,pkj->pij", offsets, offsets))[1][:, :, 0]
        way = outward[near].mean(1)
        return normals * np.where((normals * way).sum(1) < 0, -1, 1)[:, None]

    def sample(self, rng):
        """Indices of points, spread evenly."""
        return np.sort(rng.permutation(len(self.points))[:POINTS])


def means(values, cell):
    """Means of rows by cell."""
    out = np.stack([np.bincount(cell.ravel(), values[:, a]) for a in range(values.shape[1])], 1)
    return out / np.bincount(cell.ravel())[:, None]


def large_pieces(points, voxel_m):
    """Which points are on no small fragment."""
    at = np.floor((points - points.min(0)) / (2 * voxel_m)).astype(int) if len(points) else np.zeros((0, 3), int)
    grid = np.zeros(at.max(0) + 1 if len(at) else (1, 1, 1), bool)
    grid[tuple(at.T)] = True
    piece = ndimage.label(grid, np.ones((3, 3, 3)))[0][tuple(at.T)]
    return np.bincount(piece)[piece] >= MIN_PIECE * len(points) if len(piece) else np.zeros(0, bool)
