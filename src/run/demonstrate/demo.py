"""Opens and closes every joint of a finished twin by contact alone, in MuJoCo, and films it.

    python demo.py RUN OUT [--robot gripper|panda] [--tries N] [--no-film]

Writes OUT/demo.json, OUT/demo.txt, OUT/demo.gif, and OUT/demo.mp4 where the package `av` is installed. Only the robot is
driven, by bounded forces; the twin feels contact, gravity and its own joints. All parts are opened one after the other in
one scene, then closed in the other order, each by one hold or by several after another; a drawer gets a ball, is closed and
opened again. Exit: 0; 2 with a sentence on stderr where no demonstration can be given.
"""
import argparse
import importlib.util
import json
import os
import sys
from pathlib import Path

MISSING = [name for name in ("mujoco", "numpy", "PIL") if importlib.util.find_spec(name) is None]
if MISSING:
    packages = " ".join({"PIL": "pillow"}.get(name, name) for name in ("mujoco", "numpy", "PIL"))
    sys.exit(f"this Python has no {', '.join(MISSING)}: pip install {packages}")

if "--no-film" in sys.argv:
    os.environ["MUJOCO_GL"] = "disable"
elif sys.platform == "linux":  # no screen is needed
    os.environ.setdefault("MUJOCO_GL", "egl")
NO_DRAWING = "cannot draw ({}): install libegl1, or give --no-film"

try:
    import mujoco
except Exception as error:  # whatever the graphics of this machine raise
    sys.exit(NO_DRAWING.format(error))

import ball
import stage
import twin

# Shares of the range that count as opened and closed.
OPENED, CLOSED = 0.9, 0.1
# A ball stays whose middle is never farther outside the drawer's bounds, m.
STAYS = 0.005


def robot_of(name):
    if name == "gripper":
        from gripper import Gripper

        return Gripper()
    from panda import Panda

    return Panda()


def balls(spec, joints, hand):
    """Drawers that hold a ball, with the ball's place and radius."""
    model = spec.copy().compile()
    found = {}
    for joint in joints:
        data = mujoco.MjData(model)
        twin.place(model, data, {j.name: j.closed for j in joints})
        place = ball.hollow(model, data, joint, hand)
        if place:
            found[joint.name] = place
    return found


def stays(world, joint, place, tries):
    """Drops the ball, closes the drawer and opens it again."""
    middle, radius = place
    world.drop(middle)
    watch = ball.Watch(world, joint, radius)
    worst = watch.outside(world)
    moves = []
    for goal in (joint.closed, joint.open):
        moves.append(world.move(joint, goal, tries))
        worst = max(worst, watch.outside(world))
    shares = [m and m["share"] for m in moves]
    moved = None not in shares and shares[0] < CLOSED and shares[1] > OPENED
    return {"radius_m": radius, "outside_m": worst, "closed_to": shares[0], "opened_to": shares[1], "stayed": bool(moved and worst < STAYS)}


def demonstrate(world, joints, places, tries, say):
    """Opens all, closes all. One entry a joint."""
    entries = {j.name: {"joint": j.name, "kind": j.kind, "range": j.range} for j in joints}
    for joint in joints:
        entry = entries[joint.name]
        entry["begin"], entry["open"] = open_up(world, joint, tries)
        say(f"{joint.name}: opened to {text(entry['open'])}{begun(entry)}")
        entry["ball"] = None
        if joint.name in places and reached(entry["open"], joint, True):
            entry["ball"] = stays(world, joint, places[joint.name], tries)
            say(f"{joint.name}: ball {'stayed' if entry['ball']['stayed'] else 'did not stay'}")
    for joint in reversed(joints):
        entry = entries[joint.name]
        entry["close"] = world.move(joint, joint.closed, tries)
        say(f"{joint.name}: closed to {text(entry['close'])}")
        entry["success"] = bool(
            reached(entry["open"], joint, True) and reached(entry["close"], joint, False) and (entry["ball"] is None or entry["ball"]["stayed"])
        )
    return [entries[j.name] for j in joints]


def open_up(world, joint, tries):
    """Opens a joint from its closed end, or, where no hold has room there (a lid that lies flush), from the recorded
    state that was most closed: the share at which it began, and the motion."""
    move = world.move(joint, joint.open, tries)
    begin = min(joint.recorded, default=1.0)
    if move is not None or not CLOSED < begin < OPENED:
        return 0.0, move
    world.put(joint, begin)
    return begin, world.move(joint, joint.open, tries)


def begun(entry):
    return f" from {entry['begin']:.0%} as recorded" if entry["begin"] else ""


def reached(move, joint, opening):
    return move is not None and (move["share"] > OPENED if opening else move["share"] < CLOSED)


def text(move):
    return f"{move['share']:.1%} by {move['hold']}, try {move['tries']}" if move else "nothing: no hold has room"


def table(report):
    """The result as text."""
    lines = [f"{'joint':16} {'kind':6} {'held by':12} {'opened':>7} {'closed':>7} {'by':12} {'ball':7} {'':7}"]
    for entry in report["joints"]:
        opened, closed, kept = entry["open"], entry["close"], entry["ball"]
        share = lambda move: f"{move['share']:.1%}".replace("-0.0%", "0.0%") if move else "-"
        stayed = "-" if kept is None else "stayed" if kept["stayed"] else "lost"
        lines.append(
            f"{entry['joint']:16} {entry['kind']:6} {opened['hold'] if opened else '-':12} {share(opened):>7} {share(closed):>7} "
            f"{closed['hold'] if closed else '-':12} {stayed:7} {'' if entry['success'] else 'FAILED'}{begun(entry)}".rstrip()
        )
    good = sum(e["success"] for e in report["joints"])
    lines.append(f"{good} of {len(report['joints'])} joints opened and closed by contact ({report['robot']}, MuJoCo {report['mujoco']})")
    return "\n".join(lines) + "\n"


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("run", type=Path)
    arguments.add_argument("out", type=Path)
    arguments.add_argument("--robot", choices=("gripper", "panda"), default="gripper")
    arguments.add_argument("--tries", type=int, default=6)
    arguments.add_argument("--no-film", action="store_true")
    options = arguments.parse_args()
    try:
        give(options)
    except twin.Refused as refused:
        print(refused, file=sys.stderr)
        sys.exit(2)


def give(options):
    say = lambda line: print(line, file=sys.stderr, flush=True)
    spec, bare, states = twin.load(twin.mjcf_of(options.run))
    joints = twin.joints_of(bare, states)
    still = mujoco.MjData(bare)
    twin.place(bare, still, {j.name: j.closed for j in joints})
    front = twin.front(bare, still, joints)
    robot = robot_of(options.robot)
    places = balls(spec, joints, robot.hand)
    radius = min((r for _, r in places.values()), default=ball.MOST)
    model = stage.build(spec, robot, radius, front)
    world = stage.Stage(model, joints, robot)
    # Before the work: a machine that cannot draw is found out here.
    film = None if options.no_film else picture_maker(model, world, front)
    entries = demonstrate(world, joints, places, options.tries, say)
    report = {"twin": options.run.resolve().name, "robot": robot.name, "mujoco": mujoco.__version__, "joints": entries}
    report["seconds"] = float(world.steps * model.opt.timestep)
    (options.out / "demo.json").write_text(json.dumps(report, indent=1) + "\n")
    (options.out / "demo.txt").write_text(table(report))
    if film:
        film(options.out)
    print(table(report), end="")


def picture_maker(model, world, front):
    import picture

    camera = picture.camera_for(model, front, world.robot.near)
    try:
        next(iter(picture.pictures(model, [(world.data.qpos, world.data.mocap_pos, world.data.mocap_quat)], camera)))
    except Exception as error:  # whatever the graphics of this machine raise
        raise twin.Refused(NO_DRAWING.format(error)) from error
    return lambda out: picture.film(out, model, world.pictures, camera)


if __name__ == "__main__":
    main()
