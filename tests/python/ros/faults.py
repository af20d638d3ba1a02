"""Neighbors that fail, and the calls that put things right."""
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from peer import ActionClient, Peer, matched, service
from replay import Replay, expect, report, settled, shifted, values

NODE = "/artitwin"
DIAGNOSTICS = ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
STATUS = "artitwin_msgs/msg/CollectionStatus"


def restart(args):
    """The publisher of the first half of a state is killed; another publishes the rest."""
    peer = Peer()
    start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
    finish = service(peer, f"{NODE}/finish_state", "artitwin_msgs", "SetState")
    diagnostics = peer.subscriber(*DIAGNOSTICS)
    matched(start, finish)
    expect(start.call(0).success, "the state begins")
    script = Path(__file__).with_name("scenario.py")
    first = subprocess.Popen([sys.executable, script, "play", args.bags[0], "--until", "0.5", "--linger", "60", "--masks"])
    try:
        half = settled_for(peer, diagnostics, "keyframes_state0", 8)
    finally:
        first.send_signal(signal.SIGKILL)
        first.wait()
    second = Replay(peer, args.bags[:1])
    second.wait_all(True)
    second.play(0, (0.5, 1.0))
    whole = settled_for(peer, diagnostics, "keyframes_state0", 16)
    found = report(peer, diagnostics)
    done = finish.call(0)
    expect(done.success, done.message)
    print(json.dumps({"half": half, "whole": whole, "kept": int(done.keyframes), "lost": int(found["color"]["lost"]) + int(found["depth"]["lost"]),
                      "received": int(found["color"]["received"])}))


def settled_for(peer, diagnostics, key, wanted, secs=30.0):
    """Waits for a figure of the collection."""
    end = time.time() + secs
    while True:
        found = values(peer, diagnostics, "collection")
        if int(found[key]) >= wanted:
            return int(found[key])
        expect(time.time() < end, key, found)


def jumps(args):
    """Half of a state from the future, then the whole from the past: /tf, the images and /clock go back by 100 s."""
    peer = Peer()
    start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
    finish = service(peer, f"{NODE}/finish_state", "artitwin_msgs", "SetState")
    diagnostics = peer.subscriber(*DIAGNOSTICS)
    clock = peer.publisher("/clock", "rosgraph_msgs/msg/Clock", reliable=False, depth=1)
    replay = Replay(peer, args.bags[:1])
    matched(start, finish, clock)
    replay.wait_all(True)

    def at(secs):
        def change(message):
            moved = shifted(peer, message, secs)
            if message[0] == "/tf":
                stamp = peer.unpack(moved[3], moved[1]).transforms[0].header.stamp
                clock.bytes(peer.pack(peer.make("rosgraph_msgs/msg/Clock", stamp)))
            return moved
        return change

    expect(start.call(0).success, "the state begins")
    replay.play(0, (0.0, 0.5), at(100))
    future = settled_for(peer, diagnostics, "keyframes_state0", 8)
    replay.play(0, (0.0, 1.0), at(0))
    # A depth image that overtakes the color image that shows the jump is lost, and a set with it.
    settled_for(peer, diagnostics, "views_late", 15)
    back = values(peer, diagnostics, "collection")
    expect(finish.call(0).success, "the state ends")
    # The views of the past are no part of a recording that began in the future; a new one takes them.
    expect(start.call(0).success, "the state begins again")
    replay.play(0, (0.0, 1.0), at(0))
    settled_for(peer, diagnostics, "keyframes_state0", 15)
    time.sleep(1)
    done = finish.call(0)
    expect(done.success, done.message)
    print(json.dumps({"future": future, "kept_after_jump": int(back["keyframes_state0"]), "again": int(done.keyframes),
                      "jumps": int(values(peer, diagnostics, "collection")["time_jumps"])}))


def resets(args):
    """Half of a state is collected and saved, then forgotten; the other half is collected in a new session."""
    peer = Peer()
    start = service(peer, f"{NODE}/start_state", "artitwin_msgs", "SetState")
    finish = service(peer, f"{NODE}/finish_state", "artitwin_msgs", "SetState")
    save = service(peer, f"{NODE}/save", "std_srvs", "Trigger")
    reset = service(peer, f"{NODE}/reset", "std_srvs", "Trigger")
    diagnostics = peer.subscriber(*DIAGNOSTICS)
    status = peer.subscriber(f"{NODE}/status", STATUS, latched=True, depth=1)
    replay = Replay(peer, args.bags[:1])
    matched(start, finish, save, reset)
    replay.wait_all(True)
    expect(start.call(0).success, "the state begins")
    replay.play(0, (0.0, 0.5))
    settled_for(peer, diagnostics, "keyframes_state0", 8)
    saved = save.call(0)
    expect(saved.success and "8 and 0 views are on the disk" in saved.message, saved)
    session = peer.receive(status, STATUS, 5, lambda m: m.keyframes[0] == 8).session
    on_disk = sum(m[0].endswith("/compressed") for m in messages_of(Path(session) / "state0"))
    forgotten = reset.call(0)
    expect(forgotten.success, forgotten)
    fresh = peer.receive(status, STATUS, 5, lambda m: m.session != session)
    expect(fresh.phase == 0 and list(fresh.keyframes) == [0, 0], fresh)
    expect(not finish.call(0).success, "nothing is collected after a reset")
    expect(start.call(0).success, "the state begins anew")
    replay.play(0, (0.5, 1.0))
    settled_for(peer, diagnostics, "keyframes_state0", 8)
    done = finish.call(0)
    expect(done.success, done.message)
    print(json.dumps({"sessions": [session, fresh.session], "on_disk": on_disk, "kept": int(done.keyframes)}))


def messages_of(folder):
    """What a recording that is still open holds on the disk."""
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader

    found = []
    for path in sorted(folder.glob("*.mcap")):
        with path.open("rb") as file:
            try:
                for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                    found.append((channel.topic, message.log_time))
            except (McapError, EOFError):
                pass  # It has no end yet.
    return found


def diagnose(args):
    """Goals of ~/diagnose: three that cannot be, one that is canceled, one that ends in a report."""
    peer = Peer()
    action = ActionClient(peer, f"{NODE}/diagnose", "Diagnose")
    matched(action)
    down = [0.0, 0.0, -9.81]

    def ask(twin, runs):
        import numpy

        goal, accepted = action.start(twin, runs, [], numpy.array(down), False, 0)
        expect(accepted, "goals are taken")
        return goal

    for twin, runs, words in ((args.twin, [], "0 runs"), ("", args.runs, "no twin was made yet"), ("/nowhere.urdf", args.runs, "/nowhere.urdf")):
        failed = action.results.call(ask(twin, runs))
        expect(failed.status == 6 and not failed.success and words in failed.message, failed)
    goal = ask(args.twin, args.runs)
    end = time.time() + 60
    while not action.feedbacks():
        expect(time.time() < end, "there is feedback")
        time.sleep(0.002)
    reply = action.cancel(goal)
    expect(reply.return_code == 0 and len(reply.goals_canceling) == 1, reply)
    canceled = action.results.call(goal, secs=120)
    expect(canceled.status == 5 and not canceled.success, "canceled", canceled)
    action.feedbacks()
    goal = ask(args.twin, args.runs)
    feedback, result = action.follow(goal)
    expect(result.status == 4 and result.success, result)
    late = Peer()
    kind = "artitwin_msgs/msg/GapReport"
    found = late.receive(late.subscriber(f"{NODE}/gap_report", kind, latched=True, depth=1), kind, 15)
    expect(found.folder == result.folder and found.verdict == result.verdict and found.twin == args.twin, found)
    expect(json.loads(found.report)["verdict"] == found.verdict, found.report[:200])
    findings = [[f.joint, f.effect, [[p.name, p.value, p.lower, p.upper] for p in f.parameters]] for f in found.findings]
    print(json.dumps({"verdict": found.verdict, "findings": findings, "gap": [found.gap_before, found.gap_after], "unit": found.unit,
                      "folder": found.folder, "summary": found.summary, "stages": [f.stage for f in feedback], "fractions": [f.fraction for f in feedback]}))
