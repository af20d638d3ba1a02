"""Poses of a bag's color camera, as its transforms say."""

from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation, Slerp


def matrix(transform):
    t, q = transform.translation, transform.rotation
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    pose[:3, 3] = [t.x, t.y, t.z]
    return pose


def stamp(header):
    return header.stamp.sec + 1e-9 * header.stamp.nanosec


def between(samples, at):
    """The pose at a time; linear in place, spherical in rotation."""
    times = np.array([s[0] for s in samples])
    k = np.searchsorted(times, at)
    near = np.abs(times - at) < 1e-7
    if near.any():
        return samples[int(np.argmax(near))][1]
    if k in (0, len(times)):
        return None
    (t0, a), (t1, b) = samples[k - 1], samples[k]
    share = (at - t0) / (t1 - t0)
    pose = np.eye(4)
    pose[:3, :3] = Slerp([0, 1], Rotation.from_matrix(np.stack([a[:3, :3], b[:3, :3]])))(share).as_matrix()
    pose[:3, 3] = (1 - share) * a[:3, 3] + share * b[:3, 3]
    return pose


def bag_poses(bag):
    """Stamp in seconds to `world_from_camera` of every color image of a bag."""
    moving, static, stamps, optical = {}, {}, [], None
    with AnyReader([Path(bag)]) as reader:
        for connection, _, raw in reader.messages():
            if connection.msgtype == "tf2_msgs/msg/TFMessage":
                for t in reader.deserialize(raw, connection.msgtype).transforms:
                    entry = (t.header.frame_id, matrix(t.transform))
                    if connection.topic == "/tf_static":
                        static[t.child_frame_id] = entry
                    else:
                        moving.setdefault(t.child_frame_id, []).append((stamp(t.header), *entry[::-1]))
            elif "color" in connection.topic and connection.msgtype.endswith(("Image", "CompressedImage")):
                header = reader.deserialize(raw, connection.msgtype).header
                optical = optical or header.frame_id
                stamps.append(stamp(header))
    poses = {}
    for at in sorted(stamps):
        frame, pose = optical, np.eye(4)
        while pose is not None and (frame in moving or frame in static):
            if frame in moving:
                samples = sorted(moving[frame], key=lambda s: s[0])
                step = between([(t, m) for t, m, _ in samples], at)
                parent = samples[0][2]
            else:
                parent, step = static[frame]
            pose = None if step is None else step @ pose
            frame = parent
        if pose is not None:
            poses[at] = pose
    return poses


def stamps_of(bag):
    """Stamps of the color images of a bag, in the order of time."""
    stamps = []
    with AnyReader([Path(bag)]) as reader:
        for connection, _, raw in reader.messages():
            color = "color" in connection.topic and "depth" not in connection.topic
            if color and connection.msgtype.endswith(("Image", "CompressedImage")):
                stamps.append(stamp(reader.deserialize(raw, connection.msgtype).header))
    return sorted(stamps)
