"""A recorded state with a box that was not there: drawn into depth, color and mask of every view.

    python brought.py STATE OUT X Y Z SIDE

STATE and OUT are ROS 2 bags (MCAP) as `artitwin synth` makes them, X Y Z the middle of the box in the world and SIDE its length, m.
Prints in how many views it is seen.

Needs numpy, pillow, rosbags, scipy.
"""
import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation

COLORS = np.array([[200, 40, 40], [40, 160, 60], [220, 200, 60]])


def pose(transform):
    q, t = transform.rotation, transform.translation
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    matrix[:3, 3] = t.x, t.y, t.z
    return matrix


def stamp_s(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def seen_box(intrinsics, world_from_camera, middle, half):
    """Depth of a box (infinite beside it) and the axis of the face that is seen, per pixel."""
    rows, columns = np.mgrid[: intrinsics.height, : intrinsics.width]
    fx, _, cx, _, fy, cy, *_ = intrinsics.k
    rays = np.stack([(columns - cx) / fx, (rows - cy) / fy, np.ones(rows.shape)], -1) @ world_from_camera[:3, :3].T
    origin = world_from_camera[:3, 3] - middle
    with np.errstate(all="ignore"):
        ends = (-half - origin) / rays, (half - origin) / rays
    near, far = np.minimum(*ends), np.maximum(*ends)
    depth = near.max(-1)
    return np.where((depth < far.min(-1)) & (depth > 0), depth, np.inf), near.argmax(-1)


def depth_image(data):
    start = data.index(b"\x89PNG")
    return data[:start], np.array(Image.open(io.BytesIO(data[start:])))


def encoded(image, **how):
    out = io.BytesIO()
    Image.fromarray(image).save(out, **how)
    return out.getvalue()


def main():
    source, out = Path(sys.argv[1]), Path(sys.argv[2])
    middle, half = np.array([float(v) for v in sys.argv[3:6]]), float(sys.argv[6]) / 2
    with AnyReader([source]) as reader:
        messages = list(reader.messages())
        def read(topic):
            return [reader.deserialize(raw, c.msgtype) for c, _, raw in messages if c.topic.endswith(topic)]
        intrinsics = read("/color/camera_info")[0]
        link_from_camera = pose(read("/tf_static")[0].transforms[0].transform)
        moving = [t for m in read("/tf") for t in m.transforms]
        times = np.array([stamp_s(t) for t in moving])
        hits = {}
        for message in read("/compressedDepth"):
            at = np.argmin(abs(times - stamp_s(message)))
            box, axis = seen_box(intrinsics, pose(moving[at].transform) @ link_from_camera, middle, half)
            depth = depth_image(bytes(message.data))[1] / 1000
            hits[stamp_s(message)] = (box < np.where(depth > 0, depth, np.inf), box, axis)
        with Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connections = {}
            for connection, time, raw in messages:
                topic, kind = connection.topic, connection.msgtype
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=reader.typestore)
                if topic.endswith(("/compressedDepth", "/image_raw/compressed", "/object_mask")):
                    message = reader.deserialize(raw, kind)
                    hit, box, axis = hits[stamp_s(message)]
                    data = bytes(message.data)
                    if topic.endswith("/compressedDepth"):
                        head, image = depth_image(data)
                        image[hit] = np.round(1000 * box[hit])
                        data = head + encoded(image, format="png")
                    elif topic.endswith("/object_mask"):
                        image = np.frombuffer(data, np.uint8).reshape(hit.shape).copy()
                        image[hit] = 255
                        data = image.tobytes()
                    else:
                        image = np.array(Image.open(io.BytesIO(data)))
                        image[hit] = COLORS[axis[hit]]
                        data = encoded(image, format="jpeg", quality=92)
                    message.data = np.frombuffer(data, np.uint8)
                    raw = reader.typestore.serialize_cdr(message, kind)
                writer.write(connections[topic], time, raw)
    print(f"{sum(hit.any() for hit, _, _ in hits.values())} of {len(hits)} views see the box")


if __name__ == "__main__":
    main()
