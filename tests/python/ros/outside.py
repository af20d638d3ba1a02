"""Who reaches a node: `unshare --net outside.py PROGRAM FOLDER`. The node stands in one network namespace, with a neighbor on
its machine; another machine is a second namespace, joined to the first by a pair of interfaces. Prints JSON; exit code 3: namespaces
cannot be made here."""
import glob
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import time

HERE, THERE, DOMAIN = "10.9.9.1", "10.9.9.2", 62
FIRST_PORT = 7400 + 250 * DOMAIN
GROUP = "239.255.0.1"


def run(*command):
    if shutil.which(command[0]) is None or subprocess.run(command, stdout=subprocess.DEVNULL).returncode != 0:
        print(f"{' '.join(command)} failed", file=sys.stderr)
        sys.exit(3)


def second_machine():
    """A process in the second namespace, which ends with this one, and what stands before commands that are run there."""
    run("ip", "link", "set", "lo", "up")
    run("ip", "link", "add", "here", "type", "veth", "peer", "name", "there")
    holder = subprocess.Popen(["unshare", "--net", "cat"], stdin=subprocess.PIPE)
    for _ in range(100):
        if os.readlink(f"/proc/{holder.pid}/ns/net") != os.readlink("/proc/self/ns/net"):
            break
        time.sleep(0.05)
    there = ["nsenter", "--net", f"--target={holder.pid}"]
    run("ip", "link", "set", "there", "netns", str(holder.pid))
    run("ip", "addr", "add", f"{HERE}/24", "dev", "here")
    run("ip", "link", "set", "here", "up")
    for command in ("link set lo up", f"addr add {THERE}/24 dev there", "link set there up", f"route add {GROUP} dev there"):
        run(*there, "ip", *command.split())
    return holder, there


def announcement():
    """SPDP: a participant that wants to hear of the node's endpoints at THERE:9999."""
    guid = b"\x01\x10outside!\0\0"
    locator = struct.pack("<iI", 1, 9999) + bytes(12) + socket.inet_aton(THERE)

    def parameter(number, value):
        return struct.pack("<HH", number, len(value)) + value

    facts = [(0x15, b"\2\3\0\0"), (0x16, b"\1\x10\0\0"), (0x50, guid + b"\0\0\1\xc1"), (0x32, locator), (0x31, locator),
             (0x02, struct.pack("<iI", 100, 0)), (0x58, struct.pack("<I", 0x3F))]
    listed = b"".join(parameter(*fact) for fact in facts) + struct.pack("<HH", 1, 0)
    body = struct.pack("<HHI", 0, 16, 0) + b"\0\1\0\xc2" + struct.pack("<iI", 0, 1) + b"\0\3\0\0" + listed
    return b"RTPS\x02\x03\x01\x10" + guid + struct.pack("<BBH", 0x15, 5, len(body)) + body


def raw():
    """Announces itself to every port of the node, to its address and to the group; how many datagrams come back."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as back:
        back.bind((THERE, 9999))
        back.settimeout(0.2)
        out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(THERE))
        heard, end = 0, time.time() + 6
        while time.time() < end:
            for port in (FIRST_PORT, FIRST_PORT + 1, FIRST_PORT + 10, FIRST_PORT + 11):
                for address in (HERE, GROUP):
                    try:
                        out.sendto(announcement(), (address, port))
                    except ConnectionRefusedError:
                        pass  # Nobody listens there, and the system says so.
            try:
                back.recv(65536)
                heard += 1
            except TimeoutError:
                pass
        print(heard)


def ask():
    """Whether a state can be begun."""
    import peer

    peer.MATCH_SECS = 10.0
    try:
        start = peer.service(peer.Peer(), "/artitwin/start_state", "artitwin_msgs", "SetState")
        peer.matched(start)
        print(start.call(0, secs=5).success)
    except TimeoutError:
        print("nothing")


def neighbor(address):
    """Settings of Cyclone DDS for a peer that talks to HERE from an address."""
    to = "127.0.0.1" if address == "127.0.0.1" else HERE
    return (f'<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="{address}" multicast="false"/></Interfaces>'
            "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
            f'<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer Address="{to}"/></Peers></Discovery></Domain></CycloneDDS>')


def reached(program, folder, there, opened):
    """What a node reports of itself, and who reaches it."""
    from datagrams import sockets

    environment = {k: v for k, v in os.environ.items() if not k.startswith(("ROS_", "CYCLONEDDS", "DDS_PEER"))}
    environment |= {"ROS_DOMAIN_ID": str(DOMAIN)}
    opening = {} if opened else {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    out = os.path.join(folder, "open" if opened else "closed")
    node = subprocess.Popen([program, "node", "--ros-args", "-p", f"out_folder:={out}"], env=environment | opening, stderr=subprocess.PIPE, text=True)
    try:
        time.sleep(2)
        bound = sorted({address for address, _ in sockets(node.pid)})

        def reached(command, address):
            settings = environment | {"CYCLONEDDS_URI": neighbor(address)}
            where = there if address == THERE else []
            done = subprocess.run([*where, sys.executable, __file__, command], env=settings, stdout=subprocess.PIPE, text=True)
            return done.stdout.strip()

        outside = {"datagrams": reached("raw", THERE), "service": reached("ask", THERE), "own_address": reached("ask", HERE)}
        begun = len(glob.glob(os.path.join(out, "*", "state0")))
        inside = reached("ask", "127.0.0.1") if not opened else None
    finally:
        node.terminate()
        log = node.communicate(timeout=20)[1]
    return {"bound": bound, "outside": outside, "begun_from_outside": begun, "inside": inside, "log": log}


def main():
    if sys.argv[1] in ("raw", "ask"):
        return globals()[sys.argv[1]]()
    program, folder = sys.argv[1:]
    holder, there = second_machine()
    try:
        print(json.dumps({"closed": reached(program, folder, there, False), "open": reached(program, folder, there, True)}))
    finally:
        holder.kill()


if __name__ == "__main__":
    main()
