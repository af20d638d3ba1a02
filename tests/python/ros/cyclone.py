"""Cyclone DDS, and how ROS 2 maps services on it: client and number stand before the body."""
import os
import struct
from dataclasses import dataclass

# Packets that are dropped on sending, of a thousand.
LOSS = os.environ.get("XMIT_LOSS_PER_MILLE", "0")
os.environ.setdefault(
    "CYCLONEDDS_URI",
    '<CycloneDDS xmlns="https://cdds.io/config"><Domain Id="any"><General><Interfaces>'
    '<NetworkInterface name="lo" multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast>'
    "<MaxMessageSize>65500B</MaxMessageSize></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers></Discovery>'
    f"<Internal><Test><XmitLossiness>{LOSS}</XmitLossiness></Test></Internal></Domain></CycloneDDS>",
)


from cyclonedds._clayer import ddspy_take, ddspy_write  # noqa: E402
from cyclonedds.core import InstanceState, Policy, Qos, SampleState, ViewState  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import IdlStruct  # noqa: E402
from cyclonedds.idl.types import uint8  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

ANY = SampleState.Any | ViewState.Any | InstanceState.Any
join = DomainParticipant


def profile(reliable, latched, depth):
    return Qos(
        Policy.History.KeepLast(depth),
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort,
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
    )


def opaque(name):
    """A type by its DDS name; what it holds is not looked at, as bytes are handed over."""

    @dataclass
    class Opaque(IdlStruct, typename=name):
        data: uint8

    return Opaque


class Writer:
    def __init__(self, participant, name, kind, *qos):
        qos = profile(*qos)
        self.writer = DataWriter(participant, Topic(participant, name, opaque(kind), qos=qos), qos=qos)
        self.name = name

    def matched(self):
        return len(self.writer.get_matched_subscriptions())

    def bytes(self, payload):
        payload = bytes(payload) + b"\0" * (-len(payload) % 4)
        if ddspy_write(self.writer._ref, payload) < 0:
            raise OSError(f"{self.name}: write failed")


class Reader:
    def __init__(self, participant, name, kind, *qos):
        qos = profile(*qos)
        self.reader = DataReader(participant, Topic(participant, name, opaque(kind), qos=qos), qos=qos)
        self.name = name

    def matched(self):
        return len(self.reader.get_matched_publications())

    def take(self):
        got = ddspy_take(self.reader._ref, ANY, 100)
        return [bytes(data) for data, info in got if info.valid_data] if isinstance(got, list) else []


class Requests:
    """Numbers requests and finds their replies."""

    def __init__(self):
        self.client, self.number = int.from_bytes(os.urandom(8), "little"), 0

    def send(self, writer, body):
        self.number += 1
        writer.bytes(body[:4] + struct.pack("<Qq", self.client, self.number) + body[4:])
        return self.number

    def replies(self, reader):
        for payload in reader.take():
            client, number = struct.unpack("<Qq", payload[4:20])
            if client == self.client:
                yield number, payload[:4] + payload[20:]
