"""Writes bags again with the poses that `artitwin track` finds in place of their own.

    python eval/tracking/posed_bag.py POSES.txt BAG0 BAG1 OUT [--in-frame]

Needs Python 3, numpy, scipy, rosbags and mcap. `OUT/state0` and `OUT/state1` get the messages of the bags but for their
transforms, and `/tf` from `world` to the color camera's optical frame at the stamps that were tracked. With `--in-frame` the
world is moved onto that of the bags' own poses by one rigid motion of state 0, so that a box in that world (`workspace.txt`)
holds. What a reconstruction makes of them it makes of tracked poses.
"""

import argparse
from pathlib import Path

import numpy as np
from bag_poses import bag_poses
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from trajectory import frame, nearest, read_poses

STORE = get_typestore(Stores.ROS2_HUMBLE)


def transforms(stamp, pose, optical):
    """A `/tf` message with one transform, in CDR."""
    types = STORE.types
    q = Rotation.from_matrix(pose[:3, :3]).as_quat()
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp[0], nanosec=stamp[1])
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="world")
    transform = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](*map(float, pose[:3, 3])),
        rotation=types["geometry_msgs/msg/Quaternion"](*map(float, q)),
    )
    one = types["geometry_msgs/msg/TransformStamped"](header=header, child_frame_id=optical, transform=transform)
    return STORE.serialize_cdr(types["tf2_msgs/msg/TFMessage"](transforms=[one]), "tf2_msgs/msg/TFMessage")


def rewrite(bag, poses, out):
    """The bag with other poses, as one MCAP file."""
    out.mkdir(parents=True)
    files = sorted(Path(bag).glob("*.mcap")) if Path(bag).is_dir() else [Path(bag)]
    exact = {}
    with open(out / "bag.mcap", "wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        channels, optical, last = {}, None, 0
        for file in files:
            with open(file, "rb") as source:
                for schema, channel, message in make_reader(source).iter_messages():
                    if channel.topic in ("/tf", "/tf_static"):
                        continue
                    if channel.topic not in channels:
                        number = writer.register_schema(schema.name, schema.encoding, schema.data)
                        channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
                    writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
                    last = max(last, message.log_time)
                    if "color" in channel.topic and schema.name.endswith("Image"):
                        header = STORE.deserialize_cdr(message.data, schema.name).header
                        optical = header.frame_id
                        exact[header.stamp.sec + 1e-9 * header.stamp.nanosec] = (header.stamp.sec, header.stamp.nanosec)
        number = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", b"geometry_msgs/TransformStamped[] transforms\n")
        channel = writer.register_channel("/tf", "cdr", number)
        for at, pose in nearest(poses, exact).items():
            writer.add_message(channel, last, bytes(transforms(exact[at], pose, optical)), last)
        writer.finish()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("poses", type=Path)
    parser.add_argument("bags", type=Path, nargs=2)
    parser.add_argument("out", type=Path)
    parser.add_argument("--in-frame", action="store_true")
    args = parser.parse_args()
    states = read_poses(args.poses.read_text())
    if args.in_frame:
        truth = bag_poses(args.bags[0])
        motion = frame(nearest(states[0], truth), truth)
        states = [{t: motion @ pose for t, pose in s.items()} for s in states]
    for state, (poses, bag) in enumerate(zip(states, args.bags)):
        rewrite(bag, poses, args.out / f"state{state}")


if __name__ == "__main__":
    main()
