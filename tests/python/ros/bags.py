"""`bags.py read BAG`: what rosbags and mcap-ros2-support find in a bag of ours."""
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


def read(bag):
    with AnyReader([bag]) as reader:
        count = 0
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            count += 1
            if connection.msgtype.endswith("Image"):
                assert message.data.size == message.step * message.height
        assert count == reader.message_count, "metadata.yaml counts otherwise"
        qos = []
        for connection in sorted(reader.connections, key=lambda c: c.topic):
            profile = connection.ext.offered_qos_profiles[0]
            qos += [profile.reliability.name.lower(), profile.durability.name.lower()]
        duration = reader.duration
    decoded = 0
    for path in bag.glob("*.mcap"):
        with path.open("rb") as file:
            for schema, _, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
                decoded += 1
                if schema.name.endswith("Image"):
                    assert len(message.data) == message.step * message.height and message.header.frame_id == "cam"
    print(count, decoded, *qos, duration / 1e9)


if sys.argv[1] == "read":
    read(Path(sys.argv[2]))
