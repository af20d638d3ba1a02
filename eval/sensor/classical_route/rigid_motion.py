"""Rigid motions of points, as 4 x 4 matrices: fitted, applied, compared."""

import numpy as np
from scipy.spatial.transform import Rotation


def moved(motion, points):
    return points @ motion[:3, :3].T + motion[:3, 3]


def rigid(p, q):
    """Rigid motions p to q by least squares: stacks (..., points, 3)."""
    a, b = p.mean(-2, keepdims=True), q.mean(-2, keepdims=True)
    u, _, vt = np.linalg.svd(np.swapaxes(p - a, -1, -2) @ (q - b))
    v = np.swapaxes(vt, -1, -2)
    sign = np.linalg.det(v @ np.swapaxes(u, -1, -2))
    v[..., 2] *= sign[..., None]
    out = np.zeros((*p.shape[:-2], 4, 4))
    out[..., :3, :3] = v @ np.swapaxes(u, -1, -2)
    out[..., :3, 3] = b[..., 0, :] - np.einsum("...ij,...j->...i", out[..., :3, :3], a[..., 0, :])
    out[..., 3, 3] = 1
    return out


def differ(a, b, points):
    """Median distance between two motions of the same points."""
    return float(np.median(np.linalg.norm(moved(a, points) - moved(b, points), axis=1))) if len(points) else 0.0


def turn_deg(rotations):
    return np.degrees(Rotation.from_matrix(rotations).magnitude())
