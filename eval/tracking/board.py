"""Measures what a printed board of tags gives tracked recordings: length and frame against the truth, with the board and without.

    python eval/tracking/board.py --bags DIR [--artitwin PATH] [--without] [--twins DIR] NAME...

Needs what `trajectory.py` needs. `DIR/NAME` is a made object (`artitwin synth --board`). Of every state:
- length: scale that takes the tracked way to the true one (Umeyama 1991), off 1, percent;
- board, object: how far the tracked world is off the board's true frame at the board's middle and at what the cameras look at, mm;
- depth: what readings of depth are off after the correction, percent, by the factor that the sensor drew.
`--twins` reconstructs each into DIR, where it is not there yet, and says what is left in the twin, when poses and sensor are corrected:
- frame: how far the twin's world is off the board's true frame, at the object, mm, and in deg.
`--without` adds a line with `capture.board=never`, whose frame is another: its length alone is comparable.
"""

import argparse
import json
import re
import sys
from pathlib import Path

import numpy as np
from trajectory import degrees, nearest, track, true_poses

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "sensor"))
from in_frame import align, static_surface  # noqa: E402
from tier import ended  # noqa: E402


def similarity(a, b):
    """Scale of the similarity that takes points a to b."""
    ca, cb = a - a.mean(0), b - b.mean(0)
    u, d, vt = np.linalg.svd(cb.T @ ca)
    s = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    return np.trace(np.diag(d) @ s) / np.square(ca).sum()


def focus(poses):
    """The point nearest to the axes of cameras."""
    axes = np.stack([p[:3, 2] for p in poses])
    eyes = np.stack([p[:3, 3] for p in poses])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    return np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, eyes))


def measure(found, truth):
    """Errors of a state: length in percent, frame at two places in mm, turn in deg."""
    stamps = [t for t in sorted(found) if t in truth]
    a, b = np.stack([found[t] for t in stamps]), np.stack([truth[t] for t in stamps])
    off = a @ np.linalg.inv(b)
    at = lambda p: 1e3 * np.linalg.norm((off[:, :3, :3] @ p + off[:, :3, 3]).mean(0) - p)
    turn = off[:, :3, :3].mean(0)
    u, _, vt = np.linalg.svd(turn)
    return 100 * (1 / similarity(a[:, :3, 3], b[:, :3, 3]) - 1), at(np.zeros(3)), at(focus(b)), degrees(u @ vt)


def twin(recording, folder, board_from_world, args):
    """Errors of the frame of a reconstructed twin: at the object in mm, and deg."""
    folder.mkdir(parents=True, exist_ok=True)
    run, log = folder / "object", folder / "reconstruct.log"
    if not log.exists():
        states = [recording / "state0", recording / "state1"]
        options = ["--set", "capture.tracking=always", "--preset", "preview", "--name", "object"]
        ended([args.artitwin, "reconstruct", *states, "--out", folder, *options], log)
    if not run.exists():
        return "no twin | "
    seen = np.load(recording / "truth" / "state0" / "seen.npy").astype(float)
    static = seen[seen[:, 3] == 0][:, :3]
    surface, normals = static_surface(run)
    motion = align(static, surface, normals, board_from_world)
    off = motion @ np.linalg.inv(board_from_world)
    center = (board_from_world @ [*seen[:, :3].mean(0), 1])[:3]
    frame = 1e3 * np.linalg.norm(off[:3, :3] @ center + off[:3, 3] - center)
    return f"{frame:.2f} | {degrees(off[:3, :3]):.3f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bags", type=Path, required=True)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--without", action="store_true")
    parser.add_argument("--twins", type=Path)
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("names", nargs="+")
    args = parser.parse_args()
    if args.twins:
        print("| recording | frame at the object mm | turn deg |\n|---|---|---|")
        for name in args.names:
            truth = json.loads((args.bags / name / "truth.json").read_text())
            board_from_world = np.linalg.inv(np.array(truth["board"]["world_from_board"]))
            print(f"| {name} | {twin(args.bags / name, args.twins / name, board_from_world, args)} |", flush=True)
        print()
    print("| recording | state | views | tracked | with the board | length % | depth % | board mm | object mm | turn deg |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in args.names:
        folder = args.bags / name
        told = json.loads((folder / "truth.json").read_text())
        board_from_world = np.linalg.inv(np.array(told["board"]["world_from_board"]))
        truths = [{t: board_from_world @ p for t, p in true_poses(folder, k).items()} for k in range(2)]
        depth = 1 + (told.get("sensor") or {}).get("depth_scale", 0.0)
        for board in ["auto", "never"] if args.without else ["auto"]:
            options = ["--set", "capture.tracking=always", "--set", f"capture.board={board}"]
            states, said, *_ = track(args.artitwin, [folder / "state0", folder / "state1"], options)
            if args.verbose:
                print(said)
            factor = float((re.findall(r"multiplied by ([\d.]+)", said) or ["1"])[0].rstrip("."))
            seen = re.findall(r"state (\d): a board of tags was seen in (\d+)", said)
            for k, (found, truth) in enumerate(zip(states, truths)):
                length, at_board, at_object, turn = measure(nearest(found, truth), truth)
                views = dict(seen).get(str(k), "none")
                frame = f"{at_board:.2f} | {at_object:.2f} | {turn:.3f}" if board == "auto" else " | | "
                print(f"| {name} | {k} | {len(truth)} | {len(found)} | {views} | {length:+.3f} | {100 * (depth * factor - 1):+.3f} | {frame} |", flush=True)


if __name__ == "__main__":
    main()
