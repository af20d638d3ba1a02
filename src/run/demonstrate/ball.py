"""A ball in a drawer: where it fits, and whether it stays."""
import numpy as np

from hold import Map, Scene, counted
from twin import place, solids, vertices

# Radii, m; a ball's share of the height of the walls about it.
LEAST, MOST, SHARE = 0.008, 0.02, 0.4
# How level a floor is under a ball, m.
LEVEL = 0.006


def hollow(model, data, joint, hand):
    """Where a ball rests in a part that slides level, when that is open: its middle in the world and radius; or `None`.

    `data` is moved to that position. A place counts that is seen from above, is level for the ball, and has walls of the
    part on all four sides."""
    place(model, data, {joint.name: joint.open})
    scene = Scene(model, data, joint)
    if joint.kind != "slide" or abs(scene.axis[2]) > 0.3:
        return None
    along = scene.axis * [1, 1, 0] / np.linalg.norm(scene.axis[:2])
    down = np.array([0.0, 0, -1])
    map_ = Map(scene, np.stack([along, np.cross(down, along), down], 1), hand)
    depth = map_.part
    deep = np.where(np.isfinite(depth), depth, np.inf)
    # The highest wall on each side of a cell, as the least depth; the lowest of the four.
    least = [np.minimum.accumulate(deep, 0), np.minimum.accumulate(deep[::-1], 0)[::-1]]
    least += [np.minimum.accumulate(deep, 1), np.minimum.accumulate(deep[:, ::-1], 1)[:, ::-1]]
    wall = np.where(np.isfinite(deep), deep, 0) - np.max(least, axis=0)
    seen = np.isfinite(depth) & (depth < map_.other)
    box = map_.cells(2 * LEAST + 0.01)
    best = None
    for i, k in np.argwhere(seen & (wall > LEAST / SHARE) & (counted(seen, box, box) == box * box)):
        radius = float(np.clip(SHARE * wall[i, k], LEAST, MOST))
        r = int(np.ceil((radius + 0.004) / map_.cell))
        about = depth[max(i - r, 0) : i + r + 1, max(k - r, 0) : k + r + 1]
        free = (about < map_.other[max(i - r, 0) : i + r + 1, max(k - r, 0) : k + r + 1]).all()
        if not free or np.ptp(about) > LEVEL:
            continue
        # Far from the walls on all sides.
        walls = deep < depth[i, k] - radius / 2
        rows, columns = np.flatnonzero(walls[:, k]), np.flatnonzero(walls[i])
        room = min(np.abs(rows - i).min(initial=999), np.abs(columns - k).min(initial=999))
        if best is None or (radius, room) > best[0]:
            best = ((radius, room), map_.point(i, k, float(about.min())) + [0, 0, radius], radius)
    return best and best[1:]


class Watch:
    """Where the ball is, in the part that it lies in."""

    def __init__(self, stage, joint, radius):
        self.joint, self.radius = joint, radius
        self.body = stage.model.body(joint.body).id
        self.low, self.high = self._bounds(stage)

    def _bounds(self, stage):
        points = np.concatenate([vertices(stage.model, stage.data, g) for g in solids(stage.model, self.body)])
        points = self._inside(stage, points)
        return points.min(0), points.max(0)

    def _inside(self, stage, points):
        return (points - stage.data.xpos[self.body]) @ stage.data.xmat[self.body].reshape(3, 3)

    def outside(self, stage):
        """How far the ball's middle is outside the part's bounds, m."""
        ball = self._inside(stage, stage.data.body("demo_ball").xpos[None])[0]
        return float(np.linalg.norm(np.maximum(np.maximum(self.low - ball, ball - self.high), 0)))
