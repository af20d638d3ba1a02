"""`python -m artitwin.decode_video BAG NEW.mcap`: a ROS 2 recording (MCAP) whose camera images are a video, with JPEG images in its place.

It reads topics of `ffmpeg_image_transport_msgs/msg/FFMPEGPacket` and of Foxglove's `CompressedVideo`; all other messages are copied.
A frame that cannot be decoded, as those before the first key frame, is left out. It needs `pip install av pillow mcap-ros2-support`.
"""

from __future__ import annotations

import io
import struct
import sys
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

VIDEO = ("ffmpeg_image_transport_msgs/msg/FFMPEGPacket", "foxglove_msgs/msg/CompressedVideo")
IMAGE = "sensor_msgs/msg/CompressedImage"
DEFINITION = """std_msgs/Header header
string format
uint8[] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
# Quality of the JPEG files, percent: blocks of the video are coarser.
QUALITY = 95


@dataclass(frozen=True)
class Stamped:
    """What a frame of a video keeps of its packet."""

    sec: int
    nanosec: int
    frame_id: str
    log_time: int


def type_of(name: str) -> str:
    """The name of a type as ROS 2 has it."""
    package, *_, message = name.replace(".", "/").replace("::", "/").split("/")
    return f"{'foxglove_msgs' if package == 'foxglove' else package}/msg/{message}"


def image_topic(topic: str) -> str:
    """The topic of the images: without the transport behind the name of an image, so the camera_info beside it is found."""
    front, _, last = topic.rpartition("/")
    return f"{front if 'image' in front.rpartition('/')[2] else topic}/compressed" if last else topic


def compressed_image(stamped: Stamped, jpeg: bytes) -> bytes:
    """The message as little-endian CDR."""
    body = bytearray(struct.pack("<iI", stamped.sec, stamped.nanosec))
    for value in (stamped.frame_id.encode() + b"\0", b"jpeg\0", jpeg):
        body += b"\0" * (-len(body) % 4) + struct.pack("<I", len(value)) + value
    return b"\0\1\0\0" + bytes(body)


def codec_of(name: str) -> str:
    """The codec of an encoder's name (`libx264`, `hevc_nvenc`) or of a format's (`h265`)."""
    name = name.lower()
    if "265" in name or "hevc" in name:
        return "hevc"
    return next((known for known in ("av1", "vp9", "vp8", "mjpeg") if known in name), "h264")


class Decoder:
    """The decoder of one topic; frames have the stamps of their packets."""

    def __init__(self, codec: str) -> None:
        self.av = import_module("av")
        self.context = self.av.CodecContext.create(codec_of(codec), "r")
        self.stamped: dict[int, Stamped] = {}
        self.count = 0

    def frames(self, stamped: Stamped, data: bytes) -> list[tuple[Stamped, Any]]:
        """The frames that are whole with this packet."""
        packet = self.av.Packet(data)
        packet.pts = self.count
        self.stamped[self.count] = stamped
        self.count += 1
        try:
            return self._known(self.context.decode(packet))
        except self.av.error.InvalidDataError:
            return []

    def rest(self) -> list[tuple[Stamped, Any]]:
        """The frames that were kept back."""
        return self._known(self.context.decode(None))

    def _known(self, frames: list[Any]) -> list[tuple[Stamped, Any]]:
        return [(self.stamped.pop(frame.pts), frame) for frame in frames if frame.pts in self.stamped]


@dataclass
class Target:
    """The new recording."""

    writer: Any
    channels: dict[tuple[str, str], int] = field(default_factory=dict)
    images: int = 0

    def copy(self, schema: Any, channel: Any, message: Any) -> None:
        """Adds a message as it is."""
        key = (channel.topic, schema.name if schema else "")
        if key not in self.channels:
            known = self.writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
            self.channels[key] = self.writer.register_channel(channel.topic, channel.message_encoding, known, channel.metadata)
        self.writer.add_message(self.channels[key], message.log_time, message.data, message.publish_time)

    def put(self, topic: str, frames: list[tuple[Stamped, Any]]) -> None:
        """Adds frames of a video as images."""
        key = (image_topic(topic), IMAGE)
        for stamped, frame in frames:
            jpeg = io.BytesIO()
            frame.to_image().save(jpeg, "JPEG", quality=QUALITY)
            if key not in self.channels:
                schema = self.writer.register_schema(IMAGE, "ros2msg", DEFINITION.encode())
                self.channels[key] = self.writer.register_channel(key[0], "cdr", schema)
            data = compressed_image(stamped, jpeg.getvalue())
            self.writer.add_message(self.channels[key], stamped.log_time, data, stamped.log_time)
            self.images += 1


def convert(files: list[Path], target: Target) -> None:
    """Adds all messages of the files, with images in place of videos."""
    reader, factory = import_module("mcap.reader"), import_module("mcap_ros2.decoder").DecoderFactory()
    decoders: dict[str, Decoder] = {}
    for path in files:
        with path.open("rb") as opened:
            for schema, channel, message in reader.make_reader(opened).iter_messages():
                if schema is None or type_of(schema.name) not in VIDEO:
                    target.copy(schema, channel, message)
                    continue
                packet = factory.decoder_for(channel.message_encoding, schema)(message.data)
                # FFMPEGPacket has a header and the name of its encoder, CompressedVideo a stamp and a format.
                header = getattr(packet, "header", packet)
                stamp = header.stamp if hasattr(header, "stamp") else packet.timestamp
                codec = packet.encoding if hasattr(packet, "encoding") else packet.format
                if channel.topic not in decoders:
                    decoders[channel.topic] = Decoder(codec)
                stamped = Stamped(stamp.sec, stamp.nanosec, header.frame_id, message.log_time)
                target.put(channel.topic, decoders[channel.topic].frames(stamped, bytes(packet.data)))
    for topic, decoder in decoders.items():
        target.put(topic, decoder.rest())


def main() -> None:
    """Converts the recording that the arguments name."""
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    source, new = Path(sys.argv[1]), Path(sys.argv[2])
    files = sorted(source.glob("*.mcap")) if source.is_dir() else [source]
    with new.open("xb") as file:
        writer = import_module("mcap.writer").Writer(file)
        writer.start(profile="ros2", library="artitwin")
        target = Target(writer)
        convert(files, target)
        writer.finish()
    print(f"{target.images} images in {new}")


if __name__ == "__main__":
    main()
