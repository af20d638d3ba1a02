"""The live map: what comes while two states are replayed, how late, and where it stands."""
import json
import time

from peer import Peer, matched, service
from replay import Replay, expect, values

NODE = "/artitwin"
MARKERS = "visualization_msgs/msg/MarkerArray"
POSE = "geometry_msgs/msg/PoseStamped"
DELETE, DELETE_ALL = 2, 3


def nanos(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def triples(points):
    return [[float(p.x), float(p.y), float(p.z)] for p in points]


class Screen:
    """Markers of a topic as RViz keeps them."""

    def __init__(self, peer, topic):
        self.peer, self.reader = peer, peer.subscriber(f"{NODE}/{topic}", MARKERS, depth=200)
        self.markers, self.cleared, self.largest = {}, 0, 0

    def take(self):
        """Arrivals: time and stamp of every message."""
        found = []
        for payload in self.reader.take():
            self.largest = max(self.largest, len(payload))
            message = self.peer.unpack(payload, MARKERS)
            for m in message.markers:
                if m.action == DELETE_ALL:
                    self.markers, self.cleared = {}, self.cleared + 1
                elif m.action == DELETE:
                    self.markers.pop((m.ns, m.id), None)
                else:
                    expect(len(m.points) > 0, "markers have points", m.ns)
                    self.markers[m.ns, m.id] = m
            if message.markers[0].action != DELETE_ALL:
                found.append((time.time(), nanos(message.markers[0].header.stamp), message.markers[0].header.frame_id))
        return found

    def points(self, group):
        return [p for (ns, _), m in sorted(self.markers.items()) if ns == group for p in triples(m.points)]


def area_m2(points):
    import numpy

    p = numpy.array(points).reshape(-1, 3, 3)
    return float(0.5 * numpy.linalg.norm(numpy.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum())


def live(args):
    """Both states from bags; what the node shows of them while they are collected."""
    peer = Peer()
    replay = Replay(peer, args.bags)
    mesh, unseen, moved = (Screen(peer, topic) for topic in ("live_mesh", "unseen", "moved"))
    next_view = peer.subscriber(f"{NODE}/next_view", POSE, depth=100)
    diagnostics = peer.subscriber("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
    finish = service(peer, f"{NODE}/finish_state", "artitwin_msgs", "SetState")
    reset = service(peer, f"{NODE}/reset", "std_srvs", "Trigger")
    matched(start, finish, reset, mesh.reader, unseen.reader, moved.reader, next_view)
    replay.wait_all(True)
    states = []
    for state in range(2):
        expect(start.call(state).success, "a state begins")
        sent, arrived, frames, behind, view_secs, poses = {}, [], set(), [], [], []

        def look():
            for at, stamp, frame in mesh.take():
                arrived.append((at, stamp))
                frames.add(frame)
            unseen.take()
            moved.take()
            poses.extend(peer.unpack(p, POSE) for p in next_view.take())
            for payload in diagnostics.take():
                report = peer.unpack(payload, "diagnostic_msgs/msg/DiagnosticArray")
                found = {v.key: v.value for s in report.status if s.name.endswith(": live_map") for v in s.values}
                behind.append(float(found["seconds_behind"]))
                view_secs.append(float(found["seconds_a_view"]))

        # Before every message, so that what came is timed to the pause between two.
        def change(message):
            look()
            if message[0].startswith("/camera/camera/color/image_raw"):
                # The stamp of the image: seconds and nanoseconds behind the encapsulation.
                stamp = message[3][4:12]
                sent[int.from_bytes(stamp[:4], "little") * 1_000_000_000 + int.from_bytes(stamp[4:], "little")] = None
            return message

        begin = time.time()
        first = replay.bags[state][0][2]
        replay.play(state, change=change)
        end = time.time() + 4
        while time.time() < end:
            look()
            time.sleep(0.01)
        found = values(peer, diagnostics, "live_map")
        logged = {stamp: m[2] for m in replay.bags[state] if m[0].startswith("/camera/camera/color/image_raw")
                  for stamp in [int.from_bytes(m[3][4:8], "little") * 1_000_000_000 + int.from_bytes(m[3][8:12], "little")]}
        delays = []
        for stamp in sent:
            at = begin + (logged[stamp] - first) * 1e-9
            later = [t for t, s in arrived if s >= stamp]
            expect(later, "every view comes to the mesh", stamp)
            delays.append(min(later) - at)
        done = finish.call(state)
        expect(done.success, done.message)
        states.append({
            "kept": int(done.keyframes), "fused": int(found["views_fused"]), "left_out": int(found["left_out_busy"]),
            "delays": delays, "behind": max(behind), "frames": sorted(frames), "mesh": mesh.points("live_mesh")[::3],
            "largest": max(mesh.largest, unseen.largest, moved.largest),
            "unseen_m2": area_m2(unseen.points("unseen")) if unseen.points("unseen") else 0.0,
            "unseen_share": float(found["unseen_share"]), "next_views": len(poses),
            "next_view": None if not poses else [poses[-1].pose.position.x, poses[-1].pose.position.y, poses[-1].pose.position.z],
            "moved": moved.points("moved"), "appeared_m2": found["appeared_m2"], "gone_m2": found["gone_m2"],
            "map_bytes": int(found["map_bytes"]), "seconds_a_view": max(view_secs), "cleared": mesh.cleared,
        })
    # A late subscriber gets all of it within some ten seconds.
    late = Screen(peer, "live_mesh")
    shown, end = set(mesh.markers), time.time() + 15
    waited = time.time()
    while not shown <= set(late.markers) and time.time() < end:
        late.take()
        time.sleep(0.05)
    waited = time.time() - waited
    expect(shown <= set(late.markers), "a late subscriber sees all", len(shown), len(late.markers))
    expect(reset.call(0).success, "reset")
    end = time.time() + 5
    while mesh.markers and time.time() < end:
        mesh.take()
        moved.take()
        unseen.take()
        time.sleep(0.05)
    left = len(mesh.markers) + len(moved.markers) + len(unseen.markers)
    print(json.dumps({"states": states, "late_secs": waited, "left_after_reset": left}))
