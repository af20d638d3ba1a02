"""Datagrams that claim more than they hold, sent to a node by a writer and a reader that it knows."""
import json
import os
import socket
import struct
import time

import numpy
from peer import Peer, matched, service
from replay import expect, report

NODE = "/artitwin"
MIB = 1 << 20


def datagram(guid, kind, body):
    return b"RTPS\x02\x03\x01\x10" + guid[:12] + struct.pack("<BBH", kind, 1, len(body)) + body


def wide(number):
    """A sequence number: the high half first."""
    return struct.pack("<iI", number >> 32, number & 0xFFFFFFFF)


def fragment(guid, sample, size, number=1, fragment_size=64000, data=996):
    """DATA_FRAG number `number` of a sample that is said to have `size` bytes."""
    head = struct.pack("<HHI", 0, 28, 0) + guid[12:16] + wide(sample) + struct.pack("<IHHI", number, 1, fragment_size, size)
    return datagram(guid, 0x16, head + b"\0\1\0\0" + bytes(data))


def heartbeat(guid, first, last, count):
    return datagram(guid, 0x07, bytes(4) + guid[12:16] + wide(first) + wide(last) + struct.pack("<i", count))


def gap(guid, first, base):
    return datagram(guid, 0x08, bytes(4) + guid[12:16] + wide(first) + wide(base) + struct.pack("<I", 0))


def nack_fragments(reader, writer, sample, base, count):
    """NACK_FRAG for 32 fragments from `base` on."""
    body = reader[12:16] + writer[12:16] + wide(sample) + struct.pack("<IIIi", base, 32, 0xFFFFFFFF, count)
    return datagram(reader, 0x12, body)


class Target:
    """A node's process and its sockets."""

    def __init__(self, pid):
        self.pid, self.socket = pid, socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.ports = [port for _, port in sockets(pid)]

    def send(self, data):
        for port in self.ports:
            self.socket.sendto(data, ("127.0.0.1", port))

    def mib(self):
        """Memory in use."""
        with open(f"/proc/{self.pid}/status") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmRSS")) / 1024


def sockets(pid):
    """Address and port of every UDP socket of a process."""
    links = []
    for name in os.listdir(f"/proc/{pid}/fd"):
        try:
            links.append(os.readlink(f"/proc/{pid}/fd/{name}"))
        except OSError:
            pass  # It was closed meanwhile.
    found = []
    with open(f"/proc/{pid}/net/udp") as file:
        for fields in map(str.split, file.read().splitlines()[1:]):
            if f"socket:[{fields[9]}]" in links:
                address, port = fields[1].split(":")
                found.append((socket.inet_ntoa(struct.pack("=I", int(address, 16))), int(port, 16)))
    return found


def claims(args):
    """What each kind of datagram costs the node, MiB, and whether it answers then."""
    peer = Peer()
    target = Target(args.pid)
    save = service(peer, f"{NODE}/save", "std_srvs", "Trigger")
    writer = peer.publisher("/tf", "tf2_msgs/msg/TFMessage", reliable=True, depth=10)
    reader = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    matched(save, writer, reader)
    ours = writer.writer.guid.bytes
    theirs = reader.reader.get_matched_publication_data(reader.reader.get_matched_publications()[0]).key.bytes
    start, costs = target.mib(), {}

    def cost(name, datagrams, secs=2.0):
        for data in datagrams:
            target.send(data)
        most, end = 0.0, time.time() + secs
        while time.time() < end:
            most = max(most, target.mib() - start)
            time.sleep(0.05)
        expect(save.call(0).success, f"the node answers after {name}")
        costs[name] = round(most, 1)

    for size in (256 * MIB, 1024 * MIB, 0xFFFFFFF0):
        cost(f"declared {size}", [fragment(ours, 1000 + k, size) for k in range(3)])
    cost("begun", [fragment(ours, 2000 + k, 60 * MIB) for k in range(300)])
    cost("heartbeat", [heartbeat(ours, 1, 1 << 40, 1_000_000)])
    cost("gap", [gap(ours, 1 << 30, 1 << 40)])
    cost("nack", [nack_fragments(reader.reader.guid.bytes, theirs, 1 + k, base, 1000 + 2 * k) for k in range(4) for base in (0, 0xFFFFFF00)])
    # What was begun above is held for 10 s, and stands in the way of more.
    time.sleep(15)
    filled = [fragment(ours, (1 << 41) + k, 20 * MIB, number, 60000, 59996) for number in range(1, 300) for k in range(5)]
    for k, data in enumerate(filled):
        target.send(data)
        if k % 20 == 0:
            time.sleep(0.005)
    time.sleep(1)
    held = target.mib() - start
    time.sleep(16)
    print(json.dumps({"costs": costs, "held": round(held, 1), "released": round(target.mib() - start, 1), "answers": save.call(0).success}))


def large(args):
    """Images of 6, 25 and 33 MB."""
    peer = Peer()
    diagnostics = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    color = peer.publisher("/camera/camera/color/image_raw", "sensor_msgs/msg/Image", reliable=True, depth=5)
    matched(color, diagnostics)
    for second, (width, height, encoding, pixel) in enumerate(((1920, 1080, "rgb8", 3), (3840, 2160, "rgb8", 3), (3840, 2160, "rgba8", 4))):
        header = peer.make("std_msgs/msg/Header", peer.make("builtin_interfaces/msg/Time", 1 + second, 0), "camera")
        data = numpy.zeros(width * height * pixel, dtype=numpy.uint8)
        color.bytes(peer.pack(peer.make("sensor_msgs/msg/Image", header, height, width, encoding, 0, width * pixel, data)))
        time.sleep(2)
    print(json.dumps({"color": report(peer, diagnostics)["color"]}))
