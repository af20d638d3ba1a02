"""A DDS peer by Cyclone DDS that speaks ROS 2's conventions on the wire.

Messages travel as bytes and are packed and unpacked by rosbags, so that neither shares code with the node.
"""
import os
import struct
import time
from dataclasses import dataclass
from pathlib import Path

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
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
ANY = SampleState.Any | ViewState.Any | InstanceState.Any
MATCH_SECS = 20.0


def typestore():
    """Types of ROS 2 and those of msg/; parts of services and actions as messages."""
    store = get_typestore(Stores.ROS2_JAZZY)

    def add(name, text):
        store.register(get_types_from_msg(text, f"artitwin_msgs/msg/{name}"))

    def parts(path):
        lines = [line.split("#")[0].rstrip() for line in (ROOT / path).read_text().splitlines()]
        return "\n".join(line for line in lines if line).split("---")

    add("CollectionStatus", (ROOT / "msg/msg/CollectionStatus.msg").read_text())
    request, response = parts("msg/srv/SetState.srv")
    add("SetState_Request", request)
    add("SetState_Response", response)
    goal, result, feedback = parts("msg/action/Reconstruct.action")
    add("SendGoal_Request", "uint8[16] goal_id\n" + goal)
    add("SendGoal_Response", "bool accepted\nbuiltin_interfaces/Time stamp\n")
    add("GetResult_Request", "uint8[16] goal_id\n")
    add("GetResult_Response", "int8 status\n" + result)
    add("FeedbackMessage", "uint8[16] goal_id\n" + feedback)
    add("CancelGoal_Request", "uint8[16] goal_id\nbuiltin_interfaces/Time stamp\n")
    add("GoalInfo", "uint8[16] goal_id\nbuiltin_interfaces/Time stamp\n")
    add("CancelGoal_Response", "int8 return_code\nartitwin_msgs/GoalInfo[] goals_canceling\n")
    add("Trigger_Request", "uint8 structure_needs_at_least_one_member\n")
    add("Trigger_Response", "bool success\nstring message\n")
    return store


def profile(reliable=True, latched=False, depth=10):
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
    def __init__(self, peer, dds_name, type_name, qos):
        self.peer = peer
        self.writer = DataWriter(peer.participant, Topic(peer.participant, dds_name, opaque(type_name), qos=qos), qos=qos)
        self.name = dds_name

    def wait(self, count=1):
        end = time.time() + MATCH_SECS
        while len(self.writer.get_matched_subscriptions()) < count:
            if time.time() > end:
                raise TimeoutError(f"nobody subscribes to {self.name}")
            time.sleep(0.02)

    def bytes(self, payload):
        payload = bytes(payload) + b"\0" * (-len(payload) % 4)
        if ddspy_write(self.writer._ref, payload) < 0:
            raise OSError(f"{self.name}: write failed")


class Reader:
    def __init__(self, peer, dds_name, type_name, qos):
        self.reader = DataReader(peer.participant, Topic(peer.participant, dds_name, opaque(type_name), qos=qos), qos=qos)
        self.name = dds_name

    def wait(self):
        end = time.time() + MATCH_SECS
        while not self.reader.get_matched_publications():
            if time.time() > end:
                raise TimeoutError(f"nobody publishes {self.name}")
            time.sleep(0.02)

    def take(self):
        got = ddspy_take(self.reader._ref, ANY, 100)
        return [bytes(data) for data, info in got if info.valid_data] if isinstance(got, list) else []


class Peer:
    def __init__(self):
        self.participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
        self.store = typestore()

    def publisher(self, topic, kind, **qos):
        package, _, name = kind.split("/")
        return Writer(self, "rt" + topic, f"{package}::msg::dds_::{name}_", profile(**qos))

    def subscriber(self, topic, kind, **qos):
        package, _, name = kind.split("/")
        return Reader(self, "rt" + topic, f"{package}::msg::dds_::{name}_", profile(**qos))

    def unpack(self, payload, kind):
        return self.store.deserialize_cdr(payload, kind)

    def pack(self, message):
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def make(self, kind, *fields):
        return self.store.types[kind](*fields)

    def receive(self, reader, kind, secs, test=lambda m: True):
        """The next message that passes a test."""
        end = time.time() + secs
        while time.time() < end:
            for payload in reader.take():
                message = self.unpack(payload, kind)
                if test(message):
                    return message
            time.sleep(0.01)
        raise TimeoutError(f"no such message on {reader.name} within {secs} s")


class Client:
    """A service client by Cyclone's mapping: client and number stand before the body."""

    def __init__(self, peer, service, type_name, own):
        qos = profile()
        self.peer, self.own, self.number = peer, own, 0
        self.requests = Writer(peer, f"rq{service}Request", f"{type_name}_Request_", qos)
        self.replies = Reader(peer, f"rr{service}Reply", f"{type_name}_Response_", qos)
        self.client = int.from_bytes(os.urandom(8), "little")

    def wait(self):
        self.requests.wait()
        self.replies.wait()
        time.sleep(0.3)

    def send(self, *fields):
        self.number += 1
        body = self.peer.pack(self.peer.make(f"artitwin_msgs/msg/{self.own}_Request", *fields))
        self.requests.bytes(body[:4] + struct.pack("<Qq", self.client, self.number) + body[4:])
        return self.number

    def reply(self, number, secs):
        end = time.time() + secs
        while time.time() < end:
            for payload in self.replies.take():
                client, got = struct.unpack("<Qq", payload[4:20])
                if (client, got) == (self.client, number):
                    return self.peer.unpack(payload[:4] + payload[20:], f"artitwin_msgs/msg/{self.own}_Response")
            time.sleep(0.01)
        raise TimeoutError(f"no reply to request {number} of {self.requests.name} within {secs} s")

    def call(self, *fields, secs=30.0):
        return self.reply(self.send(*fields), secs)


def service(peer, name, package, kind, own=None):
    return Client(peer, name, f"{package}::srv::dds_::{kind}", own or kind)


class ActionClient:
    def __init__(self, peer, name):
        base = "artitwin_msgs::action::dds_::Reconstruct"
        self.peer = peer
        self.goals = Client(peer, f"{name}/_action/send_goal", f"{base}_SendGoal", "SendGoal")
        self.results = Client(peer, f"{name}/_action/get_result", f"{base}_GetResult", "GetResult")
        self.cancels = Client(peer, f"{name}/_action/cancel_goal", "action_msgs::srv::dds_::CancelGoal", "CancelGoal")
        self.feedback = Reader(peer, f"rt{name}/_action/feedback", f"{base}_FeedbackMessage_", profile())
        self.status = Reader(peer, f"rt{name}/_action/status", "action_msgs::msg::dds_::GoalStatusArray_", profile(latched=True))

    def wait(self):
        for part in (self.goals, self.results, self.cancels, self.feedback, self.status):
            part.wait()

    def start(self, parts, name=""):
        import numpy

        goal = numpy.frombuffer(os.urandom(16), dtype=numpy.uint8)
        response = self.goals.call(goal, parts, name)
        return goal, response.accepted

    def feedbacks(self):
        return [self.peer.unpack(p, "artitwin_msgs/msg/FeedbackMessage") for p in self.feedback.take()]

    def cancel(self, goal):
        time_type = self.peer.store.types["builtin_interfaces/msg/Time"]
        return self.cancels.call(goal, time_type(0, 0))
