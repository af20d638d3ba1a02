"""A node among peers configured as rmw_cyclonedds_cpp configures them: `unshare --net citizen.py PROGRAM FOLDER WHAT`.

The network namespace has the loopback interface and one that stands for the Ethernet card, on which Cyclone DDS sits by default. WHAT
is `services` (first calls, long replies, type hashes, parameters, /clock, outputs), `closed` (a node that talks to this machine
only), `unlisted` (no multicast, ROS_STATIC_PEERS) or `flood` (SECONDS of images at 30 Hz). Prints JSON; exit code 3: no namespaces.
"""
import json
import os
import re
import subprocess
import sys
import time

# What a ROS 2 process has: no settings of Cyclone DDS.
os.environ["CYCLONEDDS_URI"] = os.environ.get("CITIZEN_URI", "")

import numpy  # noqa: E402
from outside import GROUP, HERE, THERE, run, second_machine  # noqa: E402

DOMAIN, CARD = 66, "card"
# As rmw_cyclonedds_cpp numbers participants: so that they can be found without multicast.
NUMBERED = '<CycloneDDS><Domain Id="any"><Discovery><ParticipantIndex>auto</ParticipantIndex></Discovery></Domain></CycloneDDS>'
ANNOUNCING = ('<CycloneDDS><Domain Id="any"><Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers>'
              "</Discovery></Domain></CycloneDDS>")
CALLS = 50


def network():
    """The interfaces of a machine with an Ethernet card; the other end of the cable stands beside it."""
    run("ip", "link", "set", "lo", "up")
    run("ip", "link", "add", CARD, "type", "veth", "peer", "name", "wall")
    run("ip", "addr", "add", f"{HERE}/24", "dev", CARD)
    run("ip", "link", "set", CARD, "up")
    run("ip", "link", "set", "wall", "up")
    run("ip", "route", "add", GROUP, "dev", CARD)


def start(program, folder, **variables):
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("ROS_", "CYCLONEDDS", "RMW_"))}
    log = open(os.path.join(folder, "log"), "w+")
    command = [program, "node", "--ros-args", "-p", "out_folder:=out", "-p", "session:=session"]
    node = subprocess.Popen(command, env=kept | {"ROS_DOMAIN_ID": str(DOMAIN)} | variables, stderr=log, cwd=folder)
    time.sleep(2)
    return node, log


def stop(node, log):
    node.terminate()
    node.wait(20)
    log.seek(0)
    return log.read()


def asker(peer):
    """Clients of the parameter services of a peer, which packs their messages."""
    from definitions import SERVICES
    from peer import Client
    from rosbags.typesys import get_types_from_msg

    def client(kind, name):
        for part, text in zip(("Request", "Response"), SERVICES[f"rcl_interfaces/srv/{kind}"]):
            if f"artitwin_msgs/msg/{kind}_{part}" not in peer.store.types:
                peer.store.register(get_types_from_msg(text, f"artitwin_msgs/msg/{kind}_{part}"))
        return Client(peer, f"/artitwin/{name}", f"rcl_interfaces::srv::dds_::{kind}", kind)

    return client


def discovered(client, secs=20.0):
    """Waits as rclcpp does: until both endpoints have their counterparts, and no longer."""
    end = time.time() + secs
    while not all(e.matched() for e in client.endpoints):
        if time.time() > end:
            raise TimeoutError("the service is not there")
        time.sleep(0.001)


def first_call():
    """Seconds that the first call of a fresh process' client takes."""
    import peer as peers

    peer = peers.Peer()
    get = asker(peer)("GetParameters", "get_parameters")
    discovered(get)
    begun = time.time()
    values = get.call(["twin_name"], secs=5).values
    print(time.time() - begun if values[0].string_value == "twin" else "wrong")


def first_calls():
    seconds = []
    for _ in range(CALLS):
        done = subprocess.run([sys.executable, __file__, "first_call"], stdout=subprocess.PIPE, text=True, check=False)
        seconds.append(float(done.stdout) if done.returncode == 0 else None)
    return seconds


def user_data(peer, secs=3.0):
    """USER_DATA of all endpoints of others, and the topics that they read."""
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
    from cyclonedds.core import Policy

    found, read = {}, []
    own = str(peer.participant.guid)[:28]
    for topic in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription):
        reader = BuiltinDataReader(peer.participant, topic)
        end = time.time() + secs
        while time.time() < end:
            for sample in reader.take(N=200):
                if str(sample.key)[:28] == own or not sample.topic_name:
                    continue
                data = sample.qos[Policy.Userdata].data if Policy.Userdata in sample.qos else b""
                found[f"{sample.topic_name} {sample.key}"] = data.decode()
                if topic is BuiltinTopicDcpsSubscription:
                    read.append(sample.topic_name)
            time.sleep(0.05)
    return found, read


def text_parameter(peer, name, text):
    """A parameter with a string, as a message."""
    arrays = [numpy.array([], kind) for kind in ("u1", "?", "i8", "f8")]
    value = peer.make("rcl_interfaces/msg/ParameterValue", 4, False, 0, 0.0, text, *arrays, [])
    return peer.make("rcl_interfaces/msg/Parameter", name, value)


def services(program, folder):
    import peer as peers

    node, log = start(program, folder)
    try:
        told = {"first_calls": first_calls()}
        peer = peers.Peer()
        client = asker(peer)
        names, get = client("ListParameters", "list_parameters"), client("GetParameters", "get_parameters")
        describe, put = client("DescribeParameters", "describe_parameters"), client("SetParameters", "set_parameters")
        status = peer.subscriber("/artitwin/status", "artitwin_msgs/msg/CollectionStatus", latched=True)
        peers.matched(names, get, describe, put, status)
        told["session"] = peer.receive(status, "artitwin_msgs/msg/CollectionStatus", 5).session
        known = list(names.call([], 0).result.names)
        told["names"] = len(known)
        told["got"] = len(get.call(known).values)
        # Far more than a datagram holds.
        long = describe.call(["tracking"] * 1000, secs=20).descriptors
        told["long"] = sum(len(d.description) + len(d.additional_constraints) for d in long)
        described = describe.call(known).descriptors
        told["undescribed"] = [d.name for d in described if not d.description]

        results = put.call([text_parameter(peer, "tracking", "never"), text_parameter(peer, "color_topic", "/x")]).results
        told["set"] = [[r.successful, r.reason] for r in results]
        told["tracking"] = get.call(["tracking"]).values[0].string_value
        told["user_data"], told["read"] = user_data(peer)
        # Asks for what ~/unseen does not offer.
        eager = peer.subscriber("/artitwin/unseen", "visualization_msgs/msg/MarkerArray", latched=True)
        time.sleep(1)
        told["eager"] = eager.matched()
    finally:
        told["log"] = stop(node, log)
    return told


def hears(secs=6.0):
    """Whether the node's status comes."""
    import peer as peers

    peer = peers.Peer()
    status = peer.subscriber("/artitwin/status", "artitwin_msgs/msg/CollectionStatus", latched=True)
    try:
        peer.receive(status, "artitwin_msgs/msg/CollectionStatus", secs)
        return True
    except TimeoutError:
        return False


def closed(program, folder):
    """A peer on the Ethernet card, which announces itself to this machine, beside a node that is closed by choice and one that is alone."""
    os.environ["CYCLONEDDS_URI"] = ANNOUNCING
    told = {}
    for reach in ("LOCALHOST", "OFF"):
        node, log = start(program, folder, ROS_AUTOMATIC_DISCOVERY_RANGE=reach)
        heard = hears()
        told[reach] = {"heard": heard, "log": stop(node, log)}
    return told


def unlisted(program, folder):
    """A peer on another machine, in a network without multicast: only a list of peers helps."""
    numbered = os.environ | {"CITIZEN_URI": NUMBERED}
    holder, there = second_machine()
    told = {}
    try:
        run("ip", "link", "set", "here", "multicast", "off")
        run(*there, "ip", "link", "set", "there", "multicast", "off")
        for listed in ("", THERE):
            node, log = start(program, folder, **({"ROS_STATIC_PEERS": listed} if listed else {}))
            done = subprocess.run([*there, sys.executable, __file__, "hears"], env=numbered, stdout=subprocess.PIPE, text=True, check=False)
            told[listed or "none"] = done.stdout.strip()
            stop(node, log)
    finally:
        holder.kill()
    return told


def flood(program, folder, secs):
    """Raw color and depth of 640x480 at 30 Hz by sensor data QoS, while a state is collected and mapped."""
    node, log = start(program, folder)
    script = os.path.join(os.path.dirname(__file__), "scenario.py")
    sender = [sys.executable, script, "rate", "--frames", str(int(30 * secs)), "--hz", "30", "--collect"]
    done = subprocess.run(sender, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1]) | {"log": stop(node, log)}


def main():
    if sys.argv[1] == "first_call":
        os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
        return first_call()
    if sys.argv[1] == "hears":
        return print(hears(25.0))
    program, folder, what, *more = sys.argv[1:]
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
    if what != "unlisted":
        network()
    print(json.dumps(globals()[what](program, folder, *map(float, more))))


if __name__ == "__main__":
    main()
