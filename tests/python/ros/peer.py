"""A neighbor of the node that speaks ROS 2's conventions on the wire, by Cyclone DDS or, with DDS_PEER=fastdds, Fast DDS.

Messages travel as bytes and are packed and unpacked by rosbags, so that neither shares code with the node.
"""
import os
import time
from pathlib import Path

import numpy
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = Path(__file__).resolve().parents[3]
MATCH_SECS = 20.0


def typestore():
    """Types of ROS 2 and those of msg/; parts of services and actions as messages."""
    store = get_typestore(Stores.ROS2_JAZZY)

    def add(name, text):
        store.register(get_types_from_msg(text, f"artitwin_msgs/msg/{name}"))

    def parts(path):
        lines = [line.split("#")[0].rstrip() for line in (ROOT / path).read_text().splitlines()]
        return "\n".join(line for line in lines if line).split("---")

    for path in sorted((ROOT / "msg/msg").glob("*.msg")):
        add(path.stem, path.read_text())
    request, response = parts("msg/srv/SetState.srv")
    add("SetState_Request", request)
    add("SetState_Response", response)
    for path in sorted((ROOT / "msg/action").glob("*.action")):
        goal, result, feedback = parts(path)
        add(f"{path.stem}_SendGoal_Request", "uint8[16] goal_id\n" + goal)
        add(f"{path.stem}_SendGoal_Response", "bool accepted\nbuiltin_interfaces/Time stamp\n")
        add(f"{path.stem}_GetResult_Request", "uint8[16] goal_id\n")
        add(f"{path.stem}_GetResult_Response", "int8 status\n" + result)
        add(f"{path.stem}_FeedbackMessage", "uint8[16] goal_id\n" + feedback)
    add("CancelGoal_Request", "uint8[16] goal_id\nbuiltin_interfaces/Time stamp\n")
    add("GoalInfo", "uint8[16] goal_id\nbuiltin_interfaces/Time stamp\n")
    add("CancelGoal_Response", "int8 return_code\nartitwin_msgs/GoalInfo[] goals_canceling\n")
    add("Trigger_Request", "uint8 structure_needs_at_least_one_member\n")
    add("Trigger_Response", "bool success\nstring message\n")
    return store


class Peer:
    def __init__(self):
        import importlib

        self.dds = importlib.import_module(os.environ.get("DDS_PEER", "cyclone"))
        self.participant = self.dds.join(int(os.environ["ROS_DOMAIN_ID"]))
        self.store = typestore()

    def writer(self, dds_name, dds_type, reliable=True, latched=False, depth=10):
        return self.dds.Writer(self.participant, dds_name, dds_type, reliable, latched, depth)

    def reader(self, dds_name, dds_type, reliable=True, latched=False, depth=10):
        return self.dds.Reader(self.participant, dds_name, dds_type, reliable, latched, depth)

    def publisher(self, topic, kind, **qos):
        package, _, name = kind.split("/")
        return self.writer("rt" + topic, f"{package}::msg::dds_::{name}_", **qos)

    def subscriber(self, topic, kind, **qos):
        package, _, name = kind.split("/")
        return self.reader("rt" + topic, f"{package}::msg::dds_::{name}_", **qos)

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


def matched(*parts):
    """Waits until each writer, reader or client has its counterparts."""
    end = time.time() + MATCH_SECS
    for endpoint in [e for part in parts for e in getattr(part, "endpoints", [part])]:
        while not endpoint.matched():
            if time.time() > end:
                raise TimeoutError(f"nobody is on the other side of {endpoint.name}")
            time.sleep(0.02)
    # The other side may need longer to see this one.
    time.sleep(0.3)


class Client:
    """A service client."""

    def __init__(self, peer, service, dds_type, own):
        self.peer, self.own = peer, own
        self.numbering = peer.dds.Requests()
        self.requests = peer.writer(f"rq{service}Request", f"{dds_type}_Request_")
        self.answers = peer.reader(f"rr{service}Reply", f"{dds_type}_Response_")
        self.endpoints = [self.requests, self.answers]

    def send(self, *fields):
        body = self.peer.pack(self.peer.make(f"artitwin_msgs/msg/{self.own}_Request", *fields))
        return self.numbering.send(self.requests, body)

    def reply(self, number, secs):
        end = time.time() + secs
        while time.time() < end:
            for got, body in self.numbering.replies(self.answers):
                if got == number:
                    return self.peer.unpack(body, f"artitwin_msgs/msg/{self.own}_Response")
            time.sleep(0.01)
        raise TimeoutError(f"no reply to a request of {self.requests.name} within {secs} s")

    def call(self, *fields, secs=30.0):
        return self.reply(self.send(*fields), secs)


def service(peer, name, package, kind, own=None):
    return Client(peer, name, f"{package}::srv::dds_::{kind}", own or kind)


class ActionClient:
    def __init__(self, peer, name, kind):
        base = f"artitwin_msgs::action::dds_::{kind}"
        self.peer, self.kind = peer, kind
        self.goals = Client(peer, f"{name}/_action/send_goal", f"{base}_SendGoal", f"{kind}_SendGoal")
        self.results = Client(peer, f"{name}/_action/get_result", f"{base}_GetResult", f"{kind}_GetResult")
        self.cancels = Client(peer, f"{name}/_action/cancel_goal", "action_msgs::srv::dds_::CancelGoal", "CancelGoal")
        self.feedback = peer.reader(f"rt{name}/_action/feedback", f"{base}_FeedbackMessage_")
        self.status = peer.reader(f"rt{name}/_action/status", "action_msgs::msg::dds_::GoalStatusArray_", latched=True)
        self.endpoints = [*self.goals.endpoints, *self.results.endpoints, *self.cancels.endpoints, self.feedback, self.status]

    def start(self, *fields):
        goal = numpy.frombuffer(os.urandom(16), dtype=numpy.uint8)
        response = self.goals.call(goal, *fields)
        return goal, response.accepted

    def feedbacks(self):
        return [self.peer.unpack(p, f"artitwin_msgs/msg/{self.kind}_FeedbackMessage") for p in self.feedback.take()]

    def cancel(self, goal):
        time_type = self.peer.store.types["builtin_interfaces/msg/Time"]
        return self.cancels.call(goal, time_type(0, 0))

    def follow(self, goal):
        """All feedback of a goal, and its result once it is there."""
        number = self.results.send(goal)
        feedback, result = [], None
        while result is None:
            feedback += self.feedbacks()
            try:
                result = self.results.reply(number, 0.2)
            except TimeoutError:
                pass
        return feedback + self.feedbacks(), result
