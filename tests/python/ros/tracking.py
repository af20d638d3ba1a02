"""A camera without poses: the node follows it by what it sees."""
import json
import time

import numpy
from peer import ActionClient, Peer, matched, service
from replay import Replay, expect, values

NODE = "/artitwin"
STATUS = "artitwin_msgs/msg/CollectionStatus"
TF = "tf2_msgs/msg/TFMessage"


def matrix(transform):
    """4x4 of a geometry_msgs/Transform."""
    t, q = transform.translation, transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    found = numpy.eye(4)
    found[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    found[:3, 3] = t.x, t.y, t.z
    return found


def nanos(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def transforms(peer, payloads):
    return [t for p in payloads for t in peer.unpack(p, TF).transforms]


def errors(found, truth):
    """Largest error of the ways from the last pose to the others: meters, radians.

    But the first one: it may be of a map that no other view was placed in.
    """
    moved, turned = 0.0, 0.0
    first = max(found)
    for stamp, pose in sorted(found.items())[1:]:
        near = min(truth, key=lambda s: abs(s - stamp))
        begin = min(truth, key=lambda s: abs(s - first))
        way, true = numpy.linalg.inv(found[first]) @ pose, numpy.linalg.inv(truth[begin]) @ truth[near]
        off = numpy.linalg.inv(true) @ way
        moved = max(moved, float(numpy.linalg.norm(off[:3, 3])))
        turned = max(turned, float(numpy.arccos(numpy.clip((numpy.trace(off[:3, :3]) - 1) / 2, -1, 1))))
    return moved, turned


def tracked(args):
    """Both states without /tf: the camera's poses come back there, with their quality, and a twin is made of the views."""
    peer = Peer()
    replay = Replay(peer, args.bags)
    truth = [{nanos(t.header.stamp): matrix(t.transform) for m in bag if m[0] == "/tf" for t in transforms(peer, [m[3]])}
             for bag in replay.bags]
    replay.bags = [[m for m in bag if m[0] != "/tf"] for bag in replay.bags]
    replay.writers.pop("/tf")
    tf = peer.subscriber("/tf", TF, depth=1000)
    status = peer.subscriber(f"{NODE}/status", STATUS, latched=True, depth=100)
    diagnostics = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
    finish = service(peer, f"{NODE}/finish_state", "artitwin_msgs", "SetState")
    action = ActionClient(peer, f"{NODE}/reconstruct", "Reconstruct")
    matched(start, finish, action)
    replay.wait_all(True)
    # The node waits half a second for transforms, once: then every view goes to the tracker as it comes.
    replay.play(0, (0.0, 0.4))
    time.sleep(1.0)
    states, said = [], []
    for state in range(2):
        expect(start.call(state).success, "a state begins")
        tf.take()
        replay.play(state)
        time.sleep(3.0)
        said += [peer.unpack(p, STATUS) for p in status.take()]
        found = {nanos(t.header.stamp): (t.header.frame_id, t.child_frame_id, matrix(t.transform)) for t in transforms(peer, tf.take())}
        expect({(a, b) for a, b, _ in found.values()} == {("map", "camera_link")}, {(a, b) for a, b, _ in found.values()})
        moved, turned = errors({s: pose for s, (_, _, pose) in found.items()}, truth[state])
        done = finish.call(state)
        expect(done.success, done.message, values(peer, diagnostics, "collection"))
        up = [pose[2, 3] for _, _, pose in found.values()]
        states.append({"poses": len(found), "kept": int(done.keyframes), "moved_m": moved, "turned_rad": turned,
                       "lowest_m": float(min(up)), "highest_m": float(max(up))})
    best = max((s for s in said if s.tracked and s.inliers > 0), key=lambda s: s.views_per_second)
    quality = values(peer, diagnostics, "tracking")
    goal, accepted = action.start(2, "")
    expect(accepted)
    _, result = action.follow(goal)
    expect(result.status == 4 and result.success, result)
    print(json.dumps({"states": states, "views_per_second": float(best.views_per_second), "inliers": float(best.inliers),
                      "position_error": float(best.position_error), "hints": sorted({s.hint for s in said}),
                      "quality": quality, "folder": result.folder, "joints": list(result.joints), "motions": list(result.motions)}))
