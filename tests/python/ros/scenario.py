"""What a neighbor of the node does in a test: `scenario.py NAME ARGUMENTS`. Prints JSON; a broken expectation ends it with 1."""
import argparse
import json
import struct
import time

import numpy
from peer import ActionClient, Peer, matched, service
from datagrams import claims, large
from faults import NODE, diagnose, jumps, resets, restart
from live import live
from replay import Replay, as_poses, expect, report, settled, values
from tracking import tracked


def published(joints, motions):
    """What whoever joins now gets of a twin: its description, and the status."""
    late = Peer()
    description = late.receive(
        late.subscriber(f"{NODE}/robot_description", "std_msgs/msg/String", latched=True, depth=1), "std_msgs/msg/String", 15)
    expect(description.data.startswith("<?xml") and "file://" in description.data, description.data[:200])
    markers = late.receive(
        late.subscriber(f"{NODE}/joint_markers", "visualization_msgs/msg/MarkerArray", latched=True, depth=1),
        "visualization_msgs/msg/MarkerArray", 15)
    expect(markers.markers[0].action == 3 and len(markers.markers) == 2 + 4 * len(joints), len(markers.markers))
    expect(markers.markers[-1].ns == "object" and len(markers.markers[-1].points) == 24, markers.markers[-1])
    states = late.receive(late.subscriber("/joint_states", "sensor_msgs/msg/JointState"), "sensor_msgs/msg/JointState", 15)
    expect(list(states.name) == list(joints) and numpy.allclose(states.position, motions), states)
    links = late.receive(
        late.subscriber("/tf", "tf2_msgs/msg/TFMessage"), "tf2_msgs/msg/TFMessage", 15,
        lambda m: any(t.child_frame_id.startswith("part") for t in m.transforms))
    root = late.receive(
        late.subscriber("/tf_static", "tf2_msgs/msg/TFMessage", latched=True, depth=100), "tf2_msgs/msg/TFMessage", 15,
        lambda m: any(t.child_frame_id == links.transforms[0].header.frame_id for t in m.transforms))
    expect(root.transforms[0].header.frame_id == "world", root)
    status = late.receive(
        late.subscriber(f"{NODE}/status", "artitwin_msgs/msg/CollectionStatus", latched=True, depth=1),
        "artitwin_msgs/msg/CollectionStatus", 15, lambda m: m.phase == 5)
    return description, status


def session(args):
    """Both states from bags, a goal that is canceled, one that is not, and everything that is published then."""
    peer = Peer()
    color = "/camera/camera/color/image_raw" + ("" if args.raw else "/compressed")
    replay = Replay(peer, args.bags)
    diagnostics = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
    finish = service(peer, f"{NODE}/finish_state", "artitwin_msgs", "SetState")
    save = service(peer, f"{NODE}/save", "std_srvs", "Trigger")
    reset = service(peer, f"{NODE}/reset", "std_srvs", "Trigger")
    action = ActionClient(peer, f"{NODE}/reconstruct", "Reconstruct")
    matched(start, finish, save, reset, action)
    replay.wait([color, "/tf", "/tf_static"])
    expect(not finish.call(0).success, "a state that was not begun cannot end")
    goal, accepted = action.start(2, "")
    expect(accepted, "goals are taken")
    early = action.results.call(goal)
    expect(early.status == 6 and "states 0 and 1 have no views" in early.message, early)
    kept = []
    for state in range(2):
        # Ended without views, a state does not count.
        expect(start.call(state).success, "a state begins")
        empty = finish.call(state)
        expect(not empty.success and "no view" in empty.message and empty.keyframes == 0, empty)
        goal, _ = action.start(2, "")
        lacking = action.results.call(goal)
        expect(lacking.status == 6 and ("state 1 has no views" if state else "states 0 and 1") in lacking.message, lacking)
        begun = start.call(state)
        expect(begun.success, begun.message)
        replay.play(state)
        images = sum(m[0] == color for m in replay.bags[state])
        end = time.time() + 10
        while time.time() < end and int(values(peer, diagnostics, "collection")[f"keyframes_state{state}"]) < images:
            pass
        expect("on the disk" in save.call(0).message, "saved")
        done = finish.call(state)
        expect(done.success, done.message)
        kept.append(int(done.keyframes))
        expect(kept[-1] == images, f"state {state}: {kept[-1]} of {images} views", values(peer, diagnostics, "collection"))
    if args.cancel:
        goal, accepted = action.start(2, "")
        expect(accepted)
        while not action.feedbacks():
            time.sleep(0.02)
        reply = action.cancel(goal)
        expect(reply.return_code == 0 and len(reply.goals_canceling) == 1, reply)
        result = action.results.call(goal, secs=120)
        expect(result.status == 5 and not result.success, "canceled", result)
    action.feedbacks()
    goal, accepted = action.start(2, "")
    expect(accepted)
    other, accepted = action.start(2, "")
    expect(not accepted, "a second goal is rejected while one runs")
    # What the run reads stays where it is.
    for refused in (start.call(0), reset.call(0)):
        expect(not refused.success and "a reconstruction reads the session" in refused.message, refused)
    feedback, result = action.follow(goal)
    expect(result.status == 4 and result.success, result)
    fractions = [f.fraction for f in feedback]
    expect(len(feedback) >= 5 and fractions == sorted(fractions) and fractions[-1] > 0.9, fractions)
    expect({"capture", "register", "export"} <= {f.stage for f in feedback}, {f.stage for f in feedback})
    description, status = published(result.joints, result.motions)
    expect(list(status.keyframes) == kept, status)
    print(json.dumps({"kept": kept, "joints": list(result.joints), "motions": list(result.motions), "folder": result.folder,
                      "feedback": len(feedback), "description": len(description.data)}))


def taken_up(args):
    """A node that took up a session with a twin publishes it again, and whoever joins gets it."""
    description, _ = published(args.joints, args.motions)
    print(json.dumps({"description": len(description.data)}))


def reported(args):
    """A node that took up a session with a diagnosis publishes its report again."""
    late, kind = Peer(), "artitwin_msgs/msg/GapReport"
    found = late.receive(late.subscriber(f"{NODE}/gap_report", kind, latched=True, depth=1), kind, 15)
    print(json.dumps({"verdict": found.verdict, "folder": found.folder, "twin": found.twin, "summary": found.summary}))


def collecting(peer):
    """Begins state 0 before a camera that travels; publishes its pose and parameters with every image."""
    transform = peer.make(
        "geometry_msgs/msg/Transform", peer.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0),
        peer.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0))
    time_type = peer.store.types["builtin_interfaces/msg/Time"]
    info_type, region = peer.store.types["sensor_msgs/msg/CameraInfo"], peer.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    k = numpy.array([500.0, 0, 320, 0, 500, 240, 0, 0, 1])
    p = numpy.array([500.0, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0])
    tf = peer.publisher("/tf", "tf2_msgs/msg/TFMessage", depth=100)
    info = peer.publisher("/camera/camera/color/camera_info", "sensor_msgs/msg/CameraInfo")
    start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
    matched(tf, info, start)
    expect(start.call(0).success, "state 0 begins")

    def place(i, stamp):
        header = peer.make("std_msgs/msg/Header", time_type(*struct.unpack("<iI", stamp)), "world")
        transform.translation.x = 0.003 * i
        stamped = peer.make("geometry_msgs/msg/TransformStamped", header, "camera_color_optical_frame", transform)
        tf.bytes(peer.pack(peer.make("tf2_msgs/msg/TFMessage", [stamped])))
        if i % 10 == 0:
            header = peer.make("std_msgs/msg/Header", header.stamp, "camera_color_optical_frame")
            info.bytes(peer.pack(info_type(header, 480, 640, "plumb_bob", numpy.zeros(5), k, numpy.eye(3).ravel(), p, 0, 0, region)))

    return place


def rate(args):
    """Color and depth of 640x480 at 30 Hz; the node must get every one."""
    peer = Peer()
    diagnostics = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    header = peer.make("std_msgs/msg/Header", peer.make("builtin_interfaces/msg/Time", 1, 0), "camera_color_optical_frame")

    def image(encoding, step):
        data = numpy.zeros(step * 480, dtype=numpy.uint8)
        return bytearray(peer.pack(peer.make("sensor_msgs/msg/Image", header, 480, 640, encoding, 0, step, data)))

    color, depth = image("rgb8", 1920), image("16UC1", 1280)
    # A wall at 1 m, so that who maps what is collected has something to do.
    depth[-1280 * 480:] = numpy.full(640 * 480, 1000, dtype="<u2").tobytes()
    writers = [
        peer.publisher("/camera/camera/color/image_raw", "sensor_msgs/msg/Image", reliable=args.reliable, depth=120),
        peer.publisher("/camera/camera/aligned_depth_to_color/image_raw", "sensor_msgs/msg/Image", reliable=args.reliable, depth=120),
    ]
    matched(*writers)
    place = collecting(peer) if args.collect else lambda i, stamp: None
    time.sleep(0.5)
    resident, asked = [], time.time()
    start, late = time.time(), 0.0
    for i in range(args.frames):
        wait = start + i / args.hz - time.time()
        late = max(late, -wait)
        time.sleep(max(0.0, wait))
        stamp = struct.pack("<iI", 10 + int(i // args.hz), int(1e9 * (i % args.hz) / args.hz))
        place(i, stamp)
        for writer, payload in zip(writers, (color, depth)):
            payload[4:12] = stamp
            writer.bytes(payload)
        if time.time() > asked + 20:
            asked = time.time()
            resident += [int(peer.unpack(p, "diagnostic_msgs/msg/DiagnosticArray").status[-1].values[0].value) for p in diagnostics.take()][-1:]
    seconds = time.time() - start
    found = {part: settled(peer, diagnostics, part, "received", args.frames, 10) for part in ("color", "depth")}
    collection = values(peer, diagnostics, "collection")
    machine = values(peer, diagnostics, "machine")
    print(json.dumps({"sent": args.frames, "seconds": seconds, "latest_secs": late,
                      **{p: {k: int(v[k]) for k in ("received", "lost", "malformed", "dropped_busy")} for p, v in found.items()},
                      "matched": int(collection["matched_sets"]), "resident_bytes": int(machine["resident_bytes"]),
                      "resident_every_20_s": resident, "kept": int(collection["keyframes_state0"]),
                      "live_map": values(peer, diagnostics, "live_map")}))


def hostile(args):
    """Mutated messages on every input; the node must count each and live."""
    peer = Peer()
    random = numpy.random.default_rng(args.seed)
    diagnostics = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    replay = Replay(peer, args.bags[:1], latched_depth=100)
    replay.wait_all(False)
    sent = dict.fromkeys(replay.writers, 0)
    bag = [m for m in replay.bags[0] if m[0] != "/object_mask"]
    start = time.time()
    for i in range(args.count):
        topic, _, _, data = bag[random.integers(len(bag))]
        data = bytearray(data[: 2000 if args.short else None])
        match random.integers(4):
            case 0:
                data = data[: random.integers(4, len(data))]
            case 1:
                for at in random.integers(4, len(data), 8):
                    data[at] = random.integers(256)
            case 2:
                at = 4 * random.integers(1, max(2, len(data) // 4 - 1))
                data[at : at + 4] = b"\xff\xff\xff" + bytes([random.integers(256)])
            case _:
                data = data[:4] + bytes(random.integers(0, 256, random.integers(0, 200), dtype=numpy.uint8))
        try:
            replay.writers[topic].bytes(data)
            sent[topic] += 1
        except OSError:
            pass  # Too short even for the writer.
        if i % 20 == 0:
            time.sleep(max(0.0, start + i / args.hz - time.time()))
    time.sleep(2)
    roles = {"/tf": "tf", "/tf_static": "tf_static"}
    for topic in sent:
        if "camera_info" in topic:
            roles[topic] = "depth_info" if "depth" in topic else "camera_info"
        elif "image" in topic:
            roles[topic] = "depth" if "depth" in topic else "color"
    found = report(peer, diagnostics)
    keys = ("received", "lost", "malformed", "dropped_busy")
    seen = {topic: {k: int(found[role][k]) for k in keys} | {"sent": sent[topic]} for topic, role in roles.items()}
    collection, machine = found["collection"], found["machine"]
    print(json.dumps({"inputs": seen, "refused": sum(int(collection[f"refused_{k}"]) for k in ("header", "size", "value")),
                      "resident_bytes": int(machine["resident_bytes"]), "seconds": time.time() - start}))


def clock(args):
    """Simulated time that runs, and jumps back."""
    peer = Peer()
    writer = peer.publisher("/clock", "rosgraph_msgs/msg/Clock", reliable=False, depth=1)
    matched(writer)
    diagnostics = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    stamps = []
    for begin in (1000, 500):
        for i in range(40):
            time_now = peer.make("builtin_interfaces/msg/Time", begin + i // 10, (i % 10) * 100_000_000)
            writer.bytes(peer.pack(peer.make("rosgraph_msgs/msg/Clock", time_now)))
            time.sleep(0.05)
        found = peer.receive(diagnostics, "diagnostic_msgs/msg/DiagnosticArray", 5, lambda m: abs(m.header.stamp.sec - begin) <= 4)
        stamps.append(found.header.stamp.sec)
    jumps = int(values(peer, diagnostics, "collection")["time_jumps"])
    expect(jumps >= 1, "the jump is counted", jumps)
    print(json.dumps({"stamps": stamps, "jumps": jumps}))


def discovery(args):
    """The node as the tools of ROS 2 see it."""
    peer = Peer()
    reader = peer.reader("ros_discovery_info", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_", latched=True, depth=1)
    kind = "rmw_dds_common/msg/ParticipantEntitiesInfo"
    found = peer.receive(reader, kind, 15, lambda m: any(n.node_name == args.name and len(n.reader_gid_seq) > 8 for n in m.node_entities_info_seq))
    node = next(n for n in found.node_entities_info_seq if n.node_name == args.name)
    print(json.dumps({"name": node.node_name, "namespace": node.node_namespace, "readers": len(node.reader_gid_seq), "writers": len(node.writer_gid_seq)}))


def play(args):
    """Publishes bags to whoever subscribes; with a state, collects it but does not end it."""
    peer = Peer()
    replay = Replay(peer, args.bags, lambda m: as_poses(peer, m, args.poses) if args.poses else m)
    if args.begin is not None:
        start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
        matched(start)
        expect(start.call(args.begin).success, "the state begins")
    replay.wait_all(args.masks)
    count = sum(replay.play(number, (0.0, args.until)) for number in range(len(args.bags)))
    time.sleep(args.linger)
    print(json.dumps({"sent": count}))


def automatic(args):
    """Both bags one after the other, with no service called; the states must be found."""
    peer = Peer()
    replay = Replay(peer, args.bags)
    status = peer.subscriber(f"{NODE}/status", "artitwin_msgs/msg/CollectionStatus", latched=True, depth=1)
    replay.wait_all(False)
    phases = []
    for state in range(2):
        replay.play(state)
        end = time.time() + 3
        while time.time() < end:
            phases += [int(peer.unpack(p, "artitwin_msgs/msg/CollectionStatus").phase) for p in status.take()]
            time.sleep(0.05)
    print(json.dumps({"phases": phases}))


def main():
    parser = argparse.ArgumentParser()
    commands = parser.add_subparsers(required=True)
    for function in (session, rate, hostile, clock, discovery, automatic, play, restart, jumps, resets, diagnose, claims, large,
                     taken_up, reported, tracked, live):
        command = commands.add_parser(function.__name__)
        command.set_defaults(function=function)
        if function in (session, hostile, automatic, play, restart, jumps, resets, tracked, live):
            command.add_argument("bags", nargs="+")
        if function is session:
            command.add_argument("--raw", action="store_true")
            command.add_argument("--cancel", action="store_true")
        if function is claims:
            command.add_argument("--pid", type=int, required=True)
        if function is taken_up:
            command.add_argument("--joints", nargs="+", required=True)
            command.add_argument("--motions", nargs="+", type=float, required=True)
        if function is rate:
            command.add_argument("--frames", type=int, default=300)
            command.add_argument("--hz", type=float, default=30.0)
            command.add_argument("--reliable", action="store_true")
            command.add_argument("--collect", action="store_true")
        if function is hostile:
            command.add_argument("--count", type=int, default=2000)
            command.add_argument("--hz", type=float, default=1000.0)
            command.add_argument("--seed", type=int, default=0)
            command.add_argument("--short", action="store_true")
        if function is play:
            command.add_argument("--begin", type=int)
            command.add_argument("--masks", action="store_true")
            command.add_argument("--linger", type=float, default=1.0)
            command.add_argument("--until", type=float, default=1.0, help="share of the recording's time")
            command.add_argument("--poses", choices=["pose", "odometry"], help="/tf as poses on /camera_pose")
        if function is diagnose:
            command.add_argument("twin")
            command.add_argument("runs", nargs="+")
        if function is discovery:
            command.add_argument("--name", default="artitwin")
    args = parser.parse_args()
    args.function(args)


if __name__ == "__main__":
    main()
