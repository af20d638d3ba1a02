"""Measures `artitwin track` against the poses that recordings hold, and prints a table.

    python eval/tracking/trajectory.py --bags DIR [--artitwin PATH] [NAME ...]

Needs Python 3, numpy, scipy, rosbags, and the program. `DIR/NAME/state0` and `state1` are bags. The truth is the poses in them, but
where `truth.json` holds those of a sensor that spoils the recorded ones (`synth --sensor handheld`). The recorded poses of
`handheld/*` are spoilt and their true ones are not known: against those, errors are at least those of the recorded poses.
CPU s is processor time a view, all threads together: two idle cores do two seconds of it in one.
Trajectories are aligned by one rigid motion a state (Umeyama 1991, without scale).
"""

import argparse
import json
import os
import re
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from bag_poses import bag_poses, stamps_of
from scipy.spatial.transform import Rotation


def align(a, b):
    """The rigid motion that takes points a to b, least squares; of few or collinear ones the poses' rotations help out."""
    ma, mb = a.mean(0), b.mean(0)
    u, _, vt = np.linalg.svd((b - mb).T @ (a - ma))
    d = np.diag([1, 1, np.sign(np.linalg.det(u @ vt))])
    motion = np.eye(4)
    motion[:3, :3] = u @ d @ vt
    motion[:3, 3] = mb - motion[:3, :3] @ ma
    return motion


def degrees(rotation):
    return np.degrees(Rotation.from_matrix(rotation).magnitude())


def compare(found, truth):
    """Absolute and relative errors: root mean squares and largest, mm and deg."""
    stamps = [t for t in sorted(found) if t in truth]
    a, b = np.stack([found[t] for t in stamps]), np.stack([truth[t] for t in stamps])
    moved = align(a[:, :3, 3], b[:, :3, 3]) @ a
    place = 1e3 * np.linalg.norm(moved[:, :3, 3] - b[:, :3, 3], axis=1)
    # The turn of the mean is that of the frames, which is no error of the camera's way.
    turn = Rotation.from_matrix(b[:, :3, :3] @ moved[:, :3, :3].transpose(0, 2, 1))
    turn = np.degrees((turn.mean().inv() * turn).magnitude())
    steps = [np.linalg.inv(np.linalg.inv(b[i]) @ b[i + 1]) @ np.linalg.inv(a[i]) @ a[i + 1] for i in range(len(a) - 1)]
    step_mm = 1e3 * np.linalg.norm([s[:3, 3] for s in steps], axis=1)
    step_deg = np.array([degrees(s[:3, :3]) for s in steps])
    apart = [np.linalg.inv(b[i]) @ b[i + 1] for i in range(len(b) - 1)]
    rms = lambda x: float(np.sqrt(np.mean(np.square(x))))
    return {
        "ate_mm": rms(place), "ate_most_mm": float(place.max()), "ate_deg": rms(turn),
        "rpe_mm": rms(step_mm), "rpe_deg": rms(step_deg),
        "step_mm": 1e3 * float(np.median([np.linalg.norm(s[:3, 3]) for s in apart])),
        "step_deg": float(np.median([degrees(s[:3, :3]) for s in apart])),
    }


def frame(found, truth):
    """The rigid motion from the tracked world to the true one, by poses."""
    stamps = [t for t in sorted(found) if t in truth]
    motions = [truth[t] @ np.linalg.inv(found[t]) for t in stamps]
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_matrix([m[:3, :3] for m in motions]).mean().as_matrix()
    eyes = np.stack([found[t][:3, 3] for t in stamps]), np.stack([truth[t][:3, 3] for t in stamps])
    motion[:3, 3] = eyes[1].mean(0) - motion[:3, :3] @ eyes[0].mean(0)
    return motion


def apart(found, truths):
    """How far state 1 lies from where state 0's world has it, where the cameras look: mm, deg."""
    frames = [frame(f, t) for f, t in zip(found, truths)]
    off = frames[1] @ np.linalg.inv(frames[0])
    axes = np.stack([p[:3, 2] for p in truths[0].values()])
    eyes = np.stack([p[:3, 3] for p in truths[0].values()])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    focus = np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, eyes))
    return 1e3 * np.linalg.norm(off[:3, :3] @ focus + off[:3, 3] - focus), degrees(off[:3, :3])


def nearest(poses, truth):
    """The same poses under the stamps of the truth."""
    keys = np.array(sorted(truth))
    return {keys[np.argmin(np.abs(keys - t))]: pose for t, pose in poses.items()}


def read_poses(text):
    """Trajectories as `artitwin track` prints them."""
    states = []
    for line in text.splitlines():
        if line.startswith("#"):
            states.append({})
        else:
            v = [float(x) for x in line.split()]
            pose = np.eye(4)
            pose[:3, 3] = v[1:4]
            pose[:3, :3] = Rotation.from_quat(v[4:]).as_matrix()
            states[-1][v[0]] = pose
    return states


def track(artitwin, bags, options):
    """Trajectories, text of stderr, seconds, and memory in MB."""
    with tempfile.NamedTemporaryFile("r") as times:
        started = time.monotonic()
        ended = subprocess.run(
            ["/usr/bin/time", "-f", "%M %U %S", "-o", times.name, artitwin, "track", *bags, *options],
            capture_output=True, text=True, check=False,
        ) if os.path.exists("/usr/bin/time") else subprocess.run(
            [artitwin, "track", *bags, *options], capture_output=True, text=True, check=False)
        seconds = time.monotonic() - started
        used = [float(x) for x in re.findall(r"[\d.]+", times.read())[-3:]]
    states = read_poses(ended.stdout)
    peak, cpu = (used[0] / 1024, used[1] + used[2]) if len(used) == 3 else (float("nan"),) * 2
    return states, ended.stderr, seconds, peak, cpu


def true_poses(folder, state):
    """True poses of a state by stamp."""
    poses = bag_poses(folder / f"state{state}")
    told = json.loads((folder / "truth.json").read_text()) if (folder / "truth.json").exists() else {}
    sensor = told.get("sensor")
    if not sensor:
        return poses
    views = sensor["states"][state]["views"]
    stamps = stamps_of(folder / f"state{state}")
    assert len(stamps) == len(views), (len(stamps), len(views))
    return {t: np.array(v["world_from_camera"]) for t, v in zip(stamps, views)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bags", type=Path, required=True)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("names", nargs="*")
    args = parser.parse_args()
    options = [o for s in args.set for o in ("--set", s)]
    names = args.names or sorted(
        str(p.parent.relative_to(args.bags)) for p in args.bags.glob("**/state0") if "truth" not in p.parts)
    print("| recording | state | views | tracked | step mm, deg | ATE mm rms, most | ATE deg | RPE mm, deg | states apart mm, deg | views/s | CPU s | MB |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name in names:
        bags = [args.bags / name / s for s in ("state0", "state1")]
        truths = [true_poses(args.bags / name, k) for k in range(len(bags))]
        states, told, seconds, peak, cpu = track(args.artitwin, bags, options)
        if args.verbose:
            print(told)
        if not states:
            print(f"| {name} | | | none: {told.strip().splitlines()[-1] if told.strip() else ''} |", flush=True)
            continue
        views = sum(len(t) for t in truths)
        between = apart([nearest(f, t) for f, t in zip(states, truths)], truths)
        for k, (found, truth) in enumerate(zip(states, truths)):
            e = compare(nearest(found, truth), truth)
            print(
                f"| {name} | {k} | {len(truth)} | {len(found)} | {e['step_mm']:.0f}, {e['step_deg']:.1f} | {e['ate_mm']:.2f}, {e['ate_most_mm']:.2f} "
                f"| {e['ate_deg']:.3f} | {e['rpe_mm']:.2f}, {e['rpe_deg']:.3f} | {between[0]:.1f}, {between[1]:.2f} | {views / seconds:.1f} | {cpu / views:.3f} | {peak:.0f} |", flush=True)


if __name__ == "__main__":
    main()
