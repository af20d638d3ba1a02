"""MCAP files by hand, so that they can be wrong where a library would not let them."""
import struct
from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"


def text(s):
    s = s if isinstance(s, bytes) else s.encode()
    return struct.pack("<I", len(s)) + s


def record(opcode, body, length=None):
    return bytes([opcode]) + struct.pack("<Q", len(body) if length is None else length) + body


def header():
    return record(1, text("ros2") + text("attack"))


def schema(number, name, definition):
    return record(3, struct.pack("<H", number) + text(name) + text("ros2msg") + text(definition))


def channel(number, of_schema, topic):
    return record(4, struct.pack("<HH", number, of_schema) + text(topic) + text("cdr") + struct.pack("<I", 0))


def message(of_channel, sequence, nanos, data):
    return record(5, struct.pack("<HIQQ", of_channel, sequence, nanos, nanos) + data)


def chunk(records):
    return record(6, bytes(16) + struct.pack("<Q", len(records)) + bytes(4) + text("") + struct.pack("<Q", len(records)) + records)


def end():
    return record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC


def write(path, messages, more=b""):
    """Messages (topic, type, definition, nanos, bytes) as a bag of one file without chunks; `more` stands behind the header."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    schemas, channels = {}, {}
    with path.open("wb") as file:
        file.write(MAGIC + header() + more)
        for sequence, (topic, kind, definition, nanos, data) in enumerate(messages):
            if kind not in schemas:
                schemas[kind] = len(schemas) + 1
                file.write(schema(schemas[kind], kind, definition))
            if (topic, kind) not in channels:
                channels[topic, kind] = len(channels)
                file.write(channel(channels[topic, kind], schemas[kind], topic))
            file.write(message(channels[topic, kind], sequence, nanos, data))
        file.write(end())
    return path


def read(path):
    """The messages of a sound file."""
    from mcap.reader import NonSeekingReader

    with Path(path).open("rb") as file:
        return [
            (c.topic, s.name, s.data, m.log_time, m.data)
            for s, c, m in NonSeekingReader(file).iter_messages(log_time_order=False)
        ]
