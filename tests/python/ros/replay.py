"""Bags that are published, and what the node reports of them."""
import sys
import time
from pathlib import Path

import numpy
from mcap.reader import NonSeekingReader
from peer import matched


def messages(bag):
    """Topic, type, time and bytes of every message of a bag, in the order of recording."""
    found = []
    for path in sorted(Path(bag).glob("*.mcap")):
        with path.open("rb") as file:
            for schema, channel, message in NonSeekingReader(file).iter_messages():
                found.append((channel.topic, schema.name, message.log_time, message.data))
    return sorted(found, key=lambda m: m[2])


class Replay:
    """Publishes bags at the pace of their recording."""

    def __init__(self, peer, bags, change=lambda m: m, latched_depth=1):
        self.bags = [[change(m) for m in messages(bag)] for bag in bags]
        self.writers = {}
        for topic, kind in sorted({(m[0], m[1]) for bag in self.bags for m in bag}):
            latched = topic == "/tf_static"
            self.writers[topic] = peer.publisher(topic, kind, reliable=True, latched=latched, depth=latched_depth if latched else 100)

    def wait(self, topics):
        matched(*(self.writers[topic] for topic in topics))
        time.sleep(0.3)

    def wait_all(self, masks):
        self.wait([t for t in self.writers if t != "/object_mask" or masks])

    def play(self, number, part=(0.0, 1.0), change=lambda m: m):
        """A part of the recording's time; what is latched always. The number of messages."""
        bag = self.bags[number]
        first, last = bag[0][2], bag[-1][2] + 1_000_000  # Fractions are not exact to the nanosecond.
        begin, end = (first + f * (last - first) for f in part)
        bag = [m for m in bag if m[0] == "/tf_static" or begin <= m[2] < end]
        start = time.time()
        for message in bag:
            topic, _, stamp, data = change(message)
            time.sleep(max(0.0, start + (message[2] - max(begin, first)) * 1e-9 - time.time()))
            self.writers[topic].bytes(data)
        return len(bag)


def shifted(peer, message, secs):
    """A message with its stamps moved by whole seconds."""
    topic, kind, stamp, data = message
    found = peer.unpack(data, kind)
    for header in [t.header for t in found.transforms] if kind.endswith("TFMessage") else [found.header]:
        header.stamp.sec += secs
    return topic, kind, stamp, peer.pack(found)


def as_poses(peer, message, form):
    """A message of /tf as PoseStamped or Odometry on /camera_pose; others as they are."""
    topic, kind, stamp, data = message
    if topic != "/tf":
        return message
    moved = peer.unpack(data, kind).transforms[0]
    t = moved.transform.translation
    pose = peer.make("geometry_msgs/msg/Pose", peer.make("geometry_msgs/msg/Point", t.x, t.y, t.z), moved.transform.rotation)
    if form == "pose":
        found = peer.make("geometry_msgs/msg/PoseStamped", moved.header, pose)
    else:
        nothing = peer.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        twist = peer.make("geometry_msgs/msg/Twist", nothing, nothing)
        found = peer.make(
            "nav_msgs/msg/Odometry", moved.header, moved.child_frame_id,
            peer.make("geometry_msgs/msg/PoseWithCovariance", pose, numpy.zeros(36)),
            peer.make("geometry_msgs/msg/TwistWithCovariance", twist, numpy.zeros(36)))
    return "/camera_pose", found.__msgtype__, stamp, peer.pack(found)


def expect(condition, *what):
    if not condition:
        print("FAILED:", *what, file=sys.stderr)
        sys.exit(1)


def report(peer, reader, secs=15.0):
    """The figures of the node's next diagnostics, by part."""
    reader.take()  # What lies there is old.
    message = peer.receive(reader, "diagnostic_msgs/msg/DiagnosticArray", secs)
    return {
        s.name.split(": ")[1]: {v.key: v.value for v in s.values} | {"message": s.message, "level": int(s.level)} for s in message.status
    }


def values(peer, reader, part):
    return report(peer, reader)[part]


def settled(peer, reader, part, key, wanted, secs=20.0):
    """Waits until a figure is there, or rises no more."""
    end, last = time.time() + secs, None
    while True:
        found = values(peer, reader, part)
        if float(found[key]) >= wanted or found[key] == last or time.time() > end:
            return found
        last = found[key]
