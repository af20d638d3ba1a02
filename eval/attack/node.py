"""The node beside hostile neighbors, in a network of its own: `lo`, and `away` with 10.9.9.1, from where nobody may reach it.

Called by attack.py, it starts itself again under `unshare -n` and hands its outcomes back as JSON lines.
"""
import json
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NODE = "/artitwin"
# Largest growth of the resident memory that a flood of small datagrams may cause, MB.
GROWTH_MB = 200


class Node:
    """The program's node as a process."""

    def __init__(self, binary, folder, session, **environment):
        folder.mkdir(parents=True, exist_ok=True)
        self.log = folder / f"{session}.log"
        arguments = [f"session:={session}", f"out_folder:={folder}", "twin_name:=drawer", "parts:=2"]
        command = [binary, "node", "--ros-args"] + [a for p in arguments for a in ("-p", p)]
        plain = {k: v for k, v in os.environ.items() if not k.startswith("ROS_") and k != "CYCLONEDDS_URI"}
        plain |= {"ROS_DOMAIN_ID": os.environ["ROS_DOMAIN_ID"], "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", **environment}
        self.process = subprocess.Popen(command, stdout=self.log.open("ab"), stderr=subprocess.STDOUT, env=plain)
        time.sleep(4)

    def alive(self):
        return self.process.poll() is None

    def memory_mb(self):
        for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1]) / 1024
        return 0.0

    def sockets(self):
        """Local address and port of its UDP sockets."""
        own = {os.readlink(f) for f in Path(f"/proc/{self.process.pid}/fd").iterdir() if f.is_symlink()}
        found = []
        for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
            fields = line.split()
            if f"socket:[{fields[9]}]" in own:
                address, port = fields[1].split(":")
                found.append((socket.inet_ntoa(struct.pack("<I", int(address, 16))), int(port, 16)))
        return sorted(found)

    def end(self):
        if self.alive():
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.process.kill()
                return "hung"
        return str(self.process.returncode)

    def panics(self):
        return self.log.read_text(errors="replace").count("panicked")


def report(family, holds, sentence):
    print(json.dumps([family, bool(holds), sentence]), flush=True)


def answers(domain_peer, secs=25.0):
    """Whether the node answers a service call of a fresh neighbor on this machine."""
    script = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from peer import Peer, matched, service\n"
        f"p = Peer(); s = service(p, '{NODE}/start_state', 'artitwin_msgs', 'SetState'); matched(s)\n"
        "print(s.call(0).message)\n"
    )
    command = [sys.executable, "-c", script, str(ROOT / "tests/python/ros")]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=secs + 20, env=domain_peer)
    except subprocess.TimeoutExpired:
        return False
    return ended.returncode == 0


def away():
    """The environment of a Cyclone DDS neighbor that lives on 10.9.9.1 alone."""
    uri = (
        '<CycloneDDS xmlns="https://cdds.io/config"><Domain Id="any"><General><Interfaces><NetworkInterface address="10.9.9.1" '
        'multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto'
        '</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer Address="10.9.9.1"/></Peers></Discovery>'
        "</Domain></CycloneDDS>"
    )
    return {**os.environ, "CYCLONEDDS_URI": uri}


def reach(binary, work):
    """Who may talk to the node."""
    node = Node(binary, work, "reach")
    found = node.sockets()
    report("node: who reaches it", found, "the node has no UDP sockets")
    report("node: who reaches it", all(a.startswith(("127.", "239.")) for a, _ in found), f"sockets stand on {found}")
    report("node: who reaches it", not answers(away(), 5.0), "a neighbor on 10.9.9.1 started a state")
    report("node: who reaches it", answers(dict(os.environ)), "a neighbor on this machine gets no answer")
    report("node: who reaches it", node.end() == "0" and not node.panics(), f"ended badly, {node.panics()} panics")


def junk(rng):
    """A datagram of noise, of a header with noise, of submessages, of an announcement."""
    noise, kind = rng.randbytes(rng.randrange(0, 300)), rng.randrange(4)
    head = b"RTPS\x02\x03\x01\x10" + rng.randbytes(12)
    if kind == 0:
        return noise
    if kind == 1:
        return head + noise
    if kind == 2:
        data = head
        for _ in range(rng.randrange(1, 4)):
            body = rng.randbytes(rng.randrange(0, 80))
            opcode = rng.choice([1, 6, 7, 8, 9, 0xC, 0xD, 0xE, 0xF, 0x12, 0x13, 0x15, 0x16, 0x80])
            data += bytes([opcode, rng.randrange(256)]) + struct.pack("<H", rng.choice([len(body), 0, 0xFFFF, 4])) + body
        return data
    parameters = b""
    for _ in range(rng.randrange(1, 12)):
        body = rng.randbytes(4 * rng.randrange(0, 9))
        key = rng.choice([0x50, 0x15, 0x16, 0x31, 0x32, 0x33, 0x2, 0x58, 0x77, 0x62, 0x2C, 0x1, rng.randrange(65536)])
        parameters += struct.pack("<HH", key, rng.choice([len(body), 0xFFFF, 3])) + body
    body = b"\0\0\x10\0" + bytes(4) + b"\0\1\0\xc2" + struct.pack("<iI", 0, rng.randrange(1, 5)) + b"\0\3\0\0" + parameters
    body += struct.pack("<HH", 1, 0)
    return head + b"\x15\x05" + struct.pack("<H", len(body)) + body


def participant(number):
    """The sound announcement of a participant that nobody is."""
    prefix = b"\x01\x10" + struct.pack("<HQ", number >> 8 & 0xFFFF, number * 2654435761 % 2**64)

    def parameter(key, data):
        return struct.pack("<HH", key, len(data)) + data

    locator = struct.pack("<iI", 1, 9) + bytes(12) + b"\x7f\0\0\1"
    body = b"\0\0\x10\0" + bytes(4) + b"\0\1\0\xc2" + struct.pack("<iI", 0, 1) + b"\0\3\0\0"
    for key, data in (
        (0x15, b"\2\3\0\0"), (0x16, b"\1\x10\0\0"), (0x50, prefix + b"\0\0\1\xc1"), (0x32, locator), (0x31, locator),
        (0x2, struct.pack("<iI", 100, 0)), (0x58, struct.pack("<I", 0x3F)),
    ):
        body += parameter(key, data)
    body += struct.pack("<HH", 1, 0)
    return b"RTPS\x02\x03\x01\x10" + prefix + b"\x15\x05" + struct.pack("<H", len(body)) + body


def floods(binary, work):
    """Noise and announcements at all of its ports."""
    node = Node(binary, work, "floods")
    ports = [p for _, p in node.sockets()]
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    rng, before = random.Random(1), node.memory_mb()

    def send(data, port):
        try:
            out.sendto(data, ("127.0.0.1", port))
        except OSError:
            pass

    for i in range(100_000):
        send(junk(rng), ports[i % len(ports)])
        if i % 200 == 0:
            time.sleep(0.01)
    report("node: 100,000 datagrams of noise", node.alive() and not node.panics(), f"{node.panics()} panics, alive {node.alive()}")
    grown = node.memory_mb() - before
    report("node: 100,000 datagrams of noise", grown < GROWTH_MB, f"memory grew by {grown:.0f} MB")
    before = node.memory_mb()
    for i in range(10_000):
        for port in ports:
            send(participant(i), port)
        if i % 50 == 0:
            time.sleep(0.02)
    time.sleep(5)
    grown = node.memory_mb() - before
    report("node: 10,000 participants that nobody is", node.alive() and grown < GROWTH_MB, f"memory grew by {grown:.0f} MB")
    report("node: 10,000 participants that nobody is", answers(dict(os.environ)), "a neighbor gets no answer after the floods")
    report("node: 10,000 participants that nobody is", node.end() == "0" and not node.panics(), f"{node.panics()} panics")


def fragments(binary, work):
    """Fragments of samples of absurd size, under the name of a neighbor that the node knows."""
    sys.path.insert(0, str(ROOT / "tests/python/ros"))
    from peer import Peer, matched

    node = Node(binary, work, "fragments")
    writer = Peer().publisher("/tf", "tf2_msgs/msg/TFMessage", reliable=True, depth=10)
    matched(writer)
    time.sleep(1)
    guid = writer.writer.guid.bytes
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ports, before = [p for _, p in node.sockets()], node.memory_mb()
    number = 1000
    for size in (256 << 20, 1 << 30, 0xFFFFFFF0, *[60 << 20] * 200):
        number += 1
        body = struct.pack("<HH", 0, 28) + bytes(4) + guid[12:16] + struct.pack("<iI", 0, number)
        body += struct.pack("<IHHI", 1, 1, 64000 if size > 64 << 20 else 1024, size) + b"\0\1\0\0" + bytes(1000)
        data = b"RTPS\x02\x03\x01\x10" + guid[:12] + b"\x16\x01" + struct.pack("<H", len(body)) + body
        for port in ports:
            out.sendto(data, ("127.0.0.1", port))
        time.sleep(0.02)
    time.sleep(1)
    grown = node.memory_mb() - before if node.alive() else float("inf")
    report("node: fragments that declare up to 4 GiB", grown < GROWTH_MB, f"memory grew by {grown:.0f} MB")
    report("node: fragments that declare up to 4 GiB", answers(dict(os.environ)), "a neighbor gets no answer afterwards")
    report("node: fragments that declare up to 4 GiB", node.end() == "0" and not node.panics(), f"{node.panics()} panics")


def payloads(binary, work):
    """Broken messages on every topic, service and action of the node."""
    sys.path.insert(0, str(ROOT / "tests/python/ros"))
    from peer import Peer
    from replay import Replay

    node = Node(binary, work, "payloads")
    peer = Peer()
    replay = Replay(peer, [ROOT / "bags/drawer/state0"])
    writers = dict(replay.writers)
    for name, kind in (("start_state", "artitwin_msgs::srv::dds_::SetState"), ("finish_state", "artitwin_msgs::srv::dds_::SetState"),
                       ("save", "std_srvs::srv::dds_::Trigger"), ("reset", "std_srvs::srv::dds_::Trigger"),
                       ("set_parameters", "rcl_interfaces::srv::dds_::SetParameters"), ("list_parameters", "rcl_interfaces::srv::dds_::ListParameters")):
        writers[name] = peer.writer(f"rq{NODE}/{name}Request", f"{kind}_Request_")
    for action in ("reconstruct", "diagnose"):
        for part, kind in (("send_goal", f"artitwin_msgs::action::dds_::{action.title()}_SendGoal"),
                           ("get_result", f"artitwin_msgs::action::dds_::{action.title()}_GetResult"),
                           ("cancel_goal", "action_msgs::srv::dds_::CancelGoal")):
            writers[f"{action}/{part}"] = peer.writer(f"rq{NODE}/{action}/_action/{part}Request", f"{kind}_Request_")
    time.sleep(4)
    rng, before = random.Random(9), node.memory_mb()
    names = sorted(writers)
    for i in range(30_000):
        name = rng.choice(names)
        if name in replay.writers:
            data = bytearray(rng.choice(replay.bags[0])[3][:2500])
        else:
            data = bytearray(b"\0\1\0\0" + struct.pack("<Qq", rng.randrange(2**64), rng.randrange(1, 2**62)) + rng.randbytes(rng.randrange(0, 120)))
        kind = rng.randrange(5)
        if kind == 0:
            data = data[: rng.randrange(4, len(data) + 1)]
        elif kind == 1:
            for _ in range(6):
                data[rng.randrange(4, len(data))] = rng.randrange(256)
        elif kind == 2 and len(data) >= 16:
            at = 4 * rng.randrange(1, len(data) // 4 - 1)
            data[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80"])
        elif kind == 3:
            data = data[:4] + rng.randbytes(rng.randrange(0, 200))
        else:
            data[:4] = rng.choice([b"\0\0\0\0", b"\0\7\0\0", b"\xff\xff\xff\xff", b"\0\x0b\0\3"])
        try:
            writers[name].bytes(bytes(data))
        except OSError:
            pass
        if i % 20 == 0:
            time.sleep(0.01)
    time.sleep(3)
    grown = node.memory_mb() - before if node.alive() else float("inf")
    report("node: 30,000 broken messages", grown < GROWTH_MB and not node.panics(), f"memory grew by {grown:.0f} MB, {node.panics()} panics")
    report("node: 30,000 broken messages", answers(dict(os.environ)), "a neighbor gets no answer afterwards")
    report("node: 30,000 broken messages", node.end() == "0" and not node.panics(), f"{node.panics()} panics")


def sessions(binary, work):
    """Two nodes on one session folder."""
    one = Node(binary, work, "shared_session")
    two = Node(binary, work, "shared_session")
    report("node: two on one session", one.alive() and not two.alive(), f"alive: {one.alive()} and {two.alive()}")
    two.end()
    report("node: two on one session", one.end() == "0", "the first ended badly")


def all_of(binary, work):
    """Runs the above in a network namespace and reads what they report."""
    from outcomes import Family

    script = (
        "ip link set lo up && (ip link add away type veth peer name other || ip tuntap add dev away mode tap) && "
        'ip addr add 10.9.9.1/24 dev away && ip link set away up && (ip link set other up || true) && exec "$@"'
    )
    command = ["unshare", "-n", "sh", "-c", script, "sh", sys.executable, __file__, str(binary), str(work / "node")]
    families = {}
    ended = subprocess.run(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "ROS_DOMAIN_ID": "77"})
    for line in ended.stdout.splitlines():
        family, holds, sentence = json.loads(line)
        families.setdefault(family, Family(family)).check(holds, sentence)
    if ended.returncode:
        families.setdefault("node", Family("node")).complain(f"not run to its end, exit code {ended.returncode}: needs root, `unshare`, cyclonedds")
    return list(families.values())


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    program, folder = Path(sys.argv[1]), Path(sys.argv[2])
    for part in (reach, floods, fragments, payloads, sessions):
        part(program, folder)
