"""`bags.py read BAG`: what rosbags and mcap-ros2-support find in a bag of ours.
`bags.py copies BAG FOLDER`: the bag's messages in every form that rosbags and mcap-ros2-support write; prints the names."""
import dataclasses
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as PlainWriter
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


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


def ros1_of(message, store):
    """A ROS 2 message as the one of ROS 1."""
    kind = store.types[message.__msgtype__]
    values = {}
    for name in (f.name for f in dataclasses.fields(kind) if not f.name.startswith("__")):
        value = 0 if name == "seq" else getattr(message, name if hasattr(message, name) else name.lower())
        if isinstance(value, list):
            value = [ros1_of(item, store) if hasattr(item, "__msgtype__") else item for item in value]
        values[name] = ros1_of(value, store) if hasattr(value, "__msgtype__") else value
    return kind(**values)


def by_ros1(found, folder):
    """Bags of ROS 1 and ROS 1 in MCAP; the names."""
    ros2, ros1 = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
    ros1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    messages = [(topic, kind, stamp, bytes(ros1.serialize_ros1(ros1_of(ros2.deserialize_cdr(data, kind), ros1), kind))) for topic, kind, _, stamp, data, _ in found]
    names = []
    for compression in (None, Ros1Writer.CompressionFormat.LZ4, Ros1Writer.CompressionFormat.BZ2):
        name = f"ros1_{compression.name.lower() if compression else 'plain'}.bag"
        writer = Ros1Writer(folder / name)
        if compression:
            writer.set_compression(compression)
        with writer:
            connections = {}
            for topic, kind, stamp, data in messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=ros1)
                writer.write(connections[topic], stamp, data)
        names.append(name)
    with (folder / "ros1.mcap").open("wb") as file:
        writer = PlainWriter(file)
        writer.start(profile="ros1", library="test")
        channels = {}
        for topic, kind, stamp, data in messages:
            if topic not in channels:
                definition, _ = ros1.generate_msgdef(kind)
                schema = writer.register_schema(kind.replace("/msg/", "/"), "ros1msg", definition.encode())
                channels[topic] = writer.register_channel(topic, "ros1", schema)
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
    return [*names, "ros1.mcap"]


def by_other_names(found, folder):
    """MCAP with type names as other writers have them; the names of the files."""
    forms = {"no_msg": lambda kind: kind.replace("/msg/", "/"), "colons": lambda kind: kind.replace("/", "::"),
             "dds": lambda kind: kind.replace("/msg/", "::msg::dds_::") + "_"}
    for name, renamed in forms.items():
        with (folder / f"{name}.mcap").open("wb") as file:
            writer = PlainWriter(file)
            writer.start(profile="ros2", library="test")
            channels = {}
            for topic, kind, definition, stamp, data, _ in found:
                if topic not in channels:
                    schema = writer.register_schema(renamed(kind), "ros2msg", definition.encode())
                    channels[topic] = writer.register_channel(topic, "" if name == "no_msg" else "cdr", schema)
                writer.add_message(channels[topic], stamp, data, stamp)
            writer.finish()
    return [f"{name}.mcap" for name in forms]


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
    print(*names, *by_ros1(found, folder), *by_other_names(found, folder))


if sys.argv[1] == "read":
    read(Path(sys.argv[2]))
else:
    copies(Path(sys.argv[2]), Path(sys.argv[3]))
