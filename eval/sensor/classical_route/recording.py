"""Frames of a recording's states with their poses, from bags of CDR messages; the box around the object."""

from dataclasses import dataclass

import cv2
import numpy as np
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation, Slerp

# Frames of a state that are used, and by how much the stamps of a frame's color and depth may differ, seconds.
MAX_FRAMES, PAIR_S = 40, 0.02
# Box where no workspace.txt is: share of its size that is left around the true points, and height above the floor, meters.
BOX_MARGIN, ABOVE_FLOOR_M = 0.05, 0.006


class Cdr:
    """Reads the fields of a message in little-endian CDR in turn."""

    def __init__(self, data):
        if data[1] != 1:
            raise ValueError("a message in big-endian CDR")
        self.data, self.at = data[4:], 0

    def numbers(self, code, count=1):
        kind = np.dtype("<" + code)
        self.at += -self.at % kind.itemsize
        out = np.frombuffer(self.data, kind, count, self.at)
        self.at += count * kind.itemsize
        return out

    def number(self, code):
        return self.numbers(code)[0].item()

    def text(self):
        return self.numbers("u1", self.number("u4")).tobytes().rstrip(b"\0").decode()

    def header(self):
        """Stamp in seconds as an integer of nanoseconds, and the frame's name."""
        seconds, nanoseconds = self.number("i4"), self.number("u4")
        return seconds * 10**9 + nanoseconds, self.text()


def transforms(data):
    """(parent, child, stamp, translation, quaternion x y z w) of a TFMessage."""
    cdr = Cdr(data)
    for _ in range(cdr.number("u4")):
        stamp, parent = cdr.header()
        child = cdr.text()
        yield parent, child, stamp, cdr.numbers("f8", 3), cdr.numbers("f8", 4)


def compressed_image(data):
    """Stamp, frame, format and bytes of a CompressedImage."""
    cdr = Cdr(data)
    stamp, frame = cdr.header()
    kind = cdr.text()
    return stamp, frame, kind, cdr.numbers("u1", cdr.number("u4"))


def camera_matrix(data):
    cdr = Cdr(data)
    cdr.header()
    cdr.numbers("u4", 2)
    cdr.text()
    cdr.numbers("f8", cdr.number("u4"))
    return cdr.numbers("f8", 9).reshape(3, 3).copy()


@dataclass
class Frame:
    color: np.ndarray
    # Meters; 0 where there is none.
    depth_m: np.ndarray
    camera: np.ndarray
    # Pose of the optical frame in the world, 4 x 4.
    pose: np.ndarray


def lifted(frame):
    """Points of all pixels in the camera."""
    h, w = frame.depth_m.shape
    x = (np.arange(w, dtype=np.float32) - frame.camera[0, 2]) / frame.camera[0, 0]
    y = (np.arange(h, dtype=np.float32) - frame.camera[1, 2]) / frame.camera[1, 1]
    return np.stack([x * frame.depth_m, y[:, None] * frame.depth_m, frame.depth_m], -1)


def pixel_rays(frame, at):
    """Directions in the world of pixels, of depth 1."""
    camera = np.hstack([(at - frame.camera[:2, 2]) / frame.camera[[0, 1], [0, 1]], np.ones((len(at), 1))])
    return camera @ frame.pose[:3, :3].T


class Tree:
    """Transforms over time."""

    def __init__(self, rows):
        self.edges = {}
        for parent, child, *rest in rows:
            self.edges.setdefault(child, (parent, []))[1].append(rest)

    def pose(self, frame, stamp):
        """Pose of a frame in the root of the tree, interpolated at a stamp, or that of the nearest stamp outside."""
        pose = np.eye(4)
        while frame in self.edges:
            frame, track = self.edges[frame]
            pose = self.between(track, stamp) @ pose
        return pose

    @staticmethod
    def between(track, stamp):
        track.sort(key=lambda t: t[0])
        times = np.array([t[0] for t in track])
        k = int(np.clip(np.searchsorted(times, stamp) - 1, 0, max(len(track) - 2, 0)))
        near = track[k : k + 2]
        turns = Rotation.from_quat([t[2] for t in near])
        out = np.eye(4)
        if len(near) == 1 or near[0][0] == near[1][0]:
            out[:3, :3], out[:3, 3] = turns[0].as_matrix(), near[0][1]
            return out
        share = np.clip((stamp - near[0][0]) / (near[1][0] - near[0][0]), 0, 1)
        out[:3, :3] = Slerp([0, 1], turns)(share).as_matrix()
        out[:3, 3] = (1 - share) * near[0][1] + share * near[1][1]
        return out


def frames_of(folder):
    """Frames of a state with their poses: depth with the nearest color, evenly thinned out."""
    rows, colors, depths, cameras = [], [], [], {}
    for file in sorted(folder.glob("*.mcap")):
        with file.open("rb") as stream:
            for schema, channel, message in make_reader(stream).iter_messages():
                if schema.name == "tf2_msgs/msg/TFMessage":
                    rows += transforms(message.data)
                elif schema.name == "sensor_msgs/msg/CameraInfo":
                    cameras[channel.topic.rsplit("/", 1)[0]] = camera_matrix(message.data)
                elif schema.name == "sensor_msgs/msg/CompressedImage":
                    image = compressed_image(message.data)
                    deep = "compressedDepth" in image[2]
                    (depths if deep else colors).append((*image, channel.topic))
    if not folder.exists():
        raise ValueError(f"no {folder.name}")
    if not depths or not colors or not cameras:
        raise ValueError(f"{folder.name} lacks compressed color, compressed depth or camera_info")
    tree, stamps = Tree(rows), np.array([c[0] for c in colors])
    out = []
    for k in np.unique(np.linspace(0, len(depths) - 1, min(MAX_FRAMES, len(depths))).round().astype(int)):
        stamp, name, _, data, topic = depths[k]
        nearest = int(np.abs(stamps - stamp).argmin())
        if abs(stamps[nearest] - stamp) > PAIR_S * 1e9:
            continue
        depth = cv2.imdecode(data[12:], cv2.IMREAD_UNCHANGED)
        color = cv2.imdecode(colors[nearest][3], cv2.IMREAD_COLOR)
        if depth is None or color is None or depth.shape != color.shape[:2]:
            raise ValueError(f"{folder.name} has an image that cannot be read, or depth that is not aligned to color")
        camera = next((m for t, m in cameras.items() if topic.startswith(t)), [*cameras.values()][0])
        out.append(Frame(color, depth.astype(np.float32) / 1000, camera, tree.pose(name, stamp)))
    if not out:
        raise ValueError(f"{folder.name} has no frame with color and depth")
    return out


def workspace(recording):
    """Lower and upper corner of the box, and whether it is the user's."""
    file = recording / "workspace.txt"
    if file.exists():
        box = np.array([float(x) for x in file.read_text().split(",")]).reshape(2, 3)
        return box, True
    seen = sorted(recording.glob("truth/state[01]/seen.npy"))
    if not seen:
        raise ValueError("neither workspace.txt nor true points")
    points = np.concatenate([np.load(f)[:, :3] for f in seen]).astype(float)
    box = np.array([points.min(0), points.max(0)])
    margin = BOX_MARGIN * (box[1] - box[0])
    box += np.array([-margin, margin])
    box[0, 2] = points[:, 2].min() + ABOVE_FLOOR_M
    return box, False


def in_box(points, box):
    return ((points > box[0]) & (points < box[1])).all(-1)
