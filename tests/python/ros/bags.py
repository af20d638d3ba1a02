"""`bags.py read BAG`: what rosbags and mcap-ros2-support find in a bag of ours.
`bags.py copies BAG FOLDER`: the bag's messages in every form that rosbags and mcap-ros2-support write; prints the names."""
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore


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


def by_rosbags(found, path, version, storage, mode):
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(path, version=version, storage_plugin=storage)
    if mode:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, _, stamp, data, _ in found:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], stamp, data)


def by_mcap_ros2(found, path, compression, crcs):
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=200_000, compression=compression, enable_crcs=crcs)
        schemas = {}
        for topic, kind, definition, stamp, _, message in found:
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, definition)
            writer.write_message(topic, schemas[kind], message, log_time=stamp, publish_time=stamp)
        writer.finish()


def copies(bag, folder):
    found = []
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as file:
            for schema, channel, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
                found.append((channel.topic, schema.name, schema.data.decode(), message.log_time, message.data, decoded))
    assert found
    mcap, sqlite3 = StoragePlugin.MCAP, StoragePlugin.SQLITE3
    names = []
    for version, storage, mode in (
        (8, mcap, None), (9, mcap, None), (9, mcap, CompressionMode.STORAGE), (9, mcap, CompressionMode.MESSAGE), (8, mcap, CompressionMode.FILE),
        (8, sqlite3, None), (9, sqlite3, CompressionMode.MESSAGE),
    ):
        name = f"{storage.name.lower()}_{version}_{mode.name.lower() if mode else 'plain'}"
        by_rosbags(found, folder / name, version, storage, mode)
        names.append(name)
    for compression in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD):
        for crcs in (True, False):
            name = f"{compression.name.lower()}{'' if crcs else '_no_crc'}.mcap"
            by_mcap_ros2(found, folder / name, compression, crcs)
            names.append(name)
    print(*names)


if sys.argv[1] == "read":
    read(Path(sys.argv[2]))
else:
    copies(Path(sys.argv[2]), Path(sys.argv[3]))
