"""Camera tracking of artitwin beside Open3D's on the same recordings, in one run; prints a table in Markdown.

    python eval/tracking/peers.py --bags DIR [--dense DIR] [--artitwin PATH] [--synth PATH] [NAME ...] > table.md

Needs Python 3 with open3d (0.20 was used; it loads libusb-1.0), opencv-python-headless, numpy, scipy, rosbags and mcap; the program
`artitwin`; and `/usr/bin/time`. `DIR/NAME/state0` and `state1` are bags. `--dense DIR` adds the recordings in DIR, and makes those
of DENSE that are not there by `artitwin synth --rate 15 --sensor handheld` (minutes each); `--synth` is the program that makes them,
where it is another.

Methods, one process each for both states of a recording, images read one by one from the bag:

- artitwin: `artitwin track`.
- graph: Open3D's tensor RGB-D odometry (hybrid, three scales) from view to view, loop closures between keyframes, one pose graph a
  state, global optimization with line processes. Every tenth view is a keyframe; pairs of keyframes
  whose tracked poses look at the same place are registered from these poses. An edge counts if at least 0.3 of the source's pixels
  with depth find a partner (Open3D's example asks for 0.3 of all pixels). If neighbours fail from standstill, ORB features and PnP
  start them, as Open3D's reconstruction system does for views that are not neighbours. Of at most 60 views, all are keyframes,
  all pairs are tried by features, neighbours from both starts (the one in which more pixels agree counts), and no edge is certain,
  for such recordings may hold views far apart. Views that no edges join to the largest group are not tracked.
- quick: the same with every fifth view as a keyframe also of at most 60 views, and no pairs by features alone; only there.
- slam: `open3d.t.pipelines.slam`, tracking against the ray-cast model. Open3D's defaults (truncation 8 voxels, 40000 blocks, trust
  in 0.07 m), but for the voxel, which is 5.8 mm at a median depth of 2 m (the default there) and less in proportion nearer. A view
  whose fitness is under 0.1 or that moves over 0.15 m is lost and not integrated, as in Open3D's online example.

Depth is used up to 3 m (Open3D's default) or 1.5 times the median of the first view, the larger.

Columns of each method: share of views tracked; ATE (root mean square after one rigid alignment a state, no scale), RPE (from one
tracked view to the next), both over the views that the method tracked; seconds and processor seconds a view; peak memory of the
process. Time and memory are those of the process for both states, start of Python and reading of the bag included. `F` marks a
trajectory with under half of the views or an ATE over 100 mm. Below the table, errors are compared again over the views that both
methods tracked: that is what counts for `worse`.
"""

import argparse
import datetime
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

DENSE = {
    "cabinet": ["--seed", "11", "--family", "cabinet", "--width", "320", "--height", "240"],
    "lamp": ["--seed", "12", "--family", "lamp", "--width", "320", "--height", "240"],
    "capped_box": ["--seed", "13", "--family", "capped_box", "--width", "320", "--height", "240"],
}
DENSE_OPTIONS = ["--rate", "15", "--sensor", "handheld"]
FIRST = ["drawer", "laptop", "fridge", "scissors", "jar_screw", "desk_lamp", "sektion_cabinet", "calvin_table", "real_box"]
FEW = 60


# The peers, each in a process of its own.


def views(bag):
    """Stamp, color (RGB), depth (mm) and intrinsics of every view, in the order of time."""
    import cv2
    from bag_poses import stamp
    from rosbags.highlevel import AnyReader

    def image(message, flag):
        data = np.asarray(message.data, np.uint8)
        if not hasattr(message, "encoding"):
            # compressedDepth: 12 bytes before the PNG.
            return cv2.imdecode(data[12:] if "compressedDepth" in message.format else data, flag)
        kind = np.uint16 if message.encoding in ("16UC1", "mono16") else np.uint8
        rows = np.frombuffer(data.tobytes(), kind).reshape(message.height, -1)
        rows = rows[:, : message.width * (1 if kind is np.uint16 else 3)]
        return rows if kind is np.uint16 else rows.reshape(message.height, message.width, 3)[:, :, :: -1 if message.encoding == "rgb8" else 1]

    pending, intrinsic = {}, None
    with AnyReader([Path(bag)]) as reader:
        wanted = [c for c in reader.connections if c.msgtype.endswith(("CameraInfo", "Image")) and "mask" not in c.topic]
        for connection, _, raw in reader.messages(wanted):
            message = reader.deserialize(raw, connection.msgtype)
            if connection.msgtype.endswith("CameraInfo"):
                intrinsic = np.array(message.k).reshape(3, 3) if "color" in connection.topic or intrinsic is None else intrinsic
            else:
                at = stamp(message.header)
                pair = pending.setdefault(at, {})
                depth = "depth" in connection.topic
                pair["depth" if depth else "color"] = message
                if len(pair) == 2 and intrinsic is not None:
                    pair = pending.pop(at)
                    yield at, np.ascontiguousarray(image(pair["color"], cv2.IMREAD_COLOR)[:, :, ::-1]), image(pair["depth"], cv2.IMREAD_UNCHANGED), intrinsic


def stamps_in(bag):
    """Stamps of the views of a bag, each once, in the order of time."""
    from bag_poses import stamps_of
    return sorted(set(stamps_of(bag)))


def true_poses(folder, state):
    """True poses of a state by stamp: those of `truth.json`, where the sensor spoils the recorded ones."""
    from bag_poses import bag_poses
    bag, told = folder / f"state{state}", folder / "truth.json"
    sensor = json.loads(told.read_text()).get("sensor") if told.exists() else None
    if not sensor:
        return bag_poses(bag)
    shown, stamps = sensor["states"][state]["views"], stamps_in(bag)
    assert len(stamps) == len(shown), (len(stamps), len(shown))
    return {t: np.array(v["world_from_camera"]) for t, v in zip(stamps, shown)}


def depth_range(depth):
    """Median depth and the depth up to which it is used, m."""
    median = 1e-3 * float(np.median(depth[depth > 0]))
    return median, max(3.0, 1.5 * median)


def tensor_image(array):
    import open3d as o3d
    return o3d.t.geometry.Image(o3d.core.Tensor(array))


def slam(bag):
    """Poses by stamp, `world_from_camera`, by Open3D's dense SLAM."""
    import open3d as o3d
    device = o3d.core.Device("CPU:0")
    poses, pose, model, following = {}, np.eye(4), None, False
    for number, (at, color, depth, intrinsic) in enumerate(views(bag)):
        if model is None:
            median, most = depth_range(depth)
            model = o3d.t.pipelines.slam.Model(min(0.0058, 0.0029 * median), 16, 40000, o3d.core.Tensor(pose), device)
            k = o3d.core.Tensor(intrinsic)
            seen, cast = (o3d.t.pipelines.slam.Frame(*depth.shape, k, device) for _ in range(2))
        seen.set_data_from_image("depth", tensor_image(depth))
        seen.set_data_from_image("color", tensor_image(color))
        if following:
            try:
                found = model.track_frame_to_model(seen, cast, 1000.0, most, 0.07)
            except RuntimeError:
                continue
            step = found.transformation.numpy()
            if found.fitness < 0.1 or np.linalg.norm(step[:3, 3]) > 0.15:
                continue
            pose = pose @ step
        following = True
        poses[at] = pose
        model.update_frame_pose(model.frame_id + 1, o3d.core.Tensor(pose))
        model.integrate(seen, 1000.0, most, 8.0)
        model.synthesize_model_frame(cast, 1000.0, 0.1, most, 8.0, False)
    return poses


class Odometry:
    """Registration of two views: motion, information, and whether enough of the depth agrees."""

    def __init__(self, intrinsic, most):
        import open3d as o3d
        self.o3d, self.intrinsic, self.most = o3d, intrinsic, most
        self.k = o3d.core.Tensor(intrinsic)
        self.criteria = [o3d.t.pipelines.odometry.OdometryConvergenceCriteria(n) for n in (20, 10, 5)]

    def __call__(self, source, target, start):
        odometry = self.o3d.t.pipelines.odometry
        try:
            found = odometry.rgbd_odometry_multi_scale(
                source["rgbd"], target["rgbd"], self.k, self.o3d.core.Tensor(start), 1000.0, self.most, self.criteria, odometry.Method.Hybrid)
            information = odometry.compute_odometry_information_matrix(
                source["rgbd"].depth, target["rgbd"].depth, self.k, found.transformation, 0.07, 1000.0, self.most).numpy()
        except RuntimeError:
            return None
        motion = found.transformation.numpy()
        if not np.isfinite(motion).all() or information[5, 5] < 0.3 * source["filled"]:
            return None
        return motion, information

    def view(self, color, depth):
        rgbd = self.o3d.t.geometry.RGBDImage(tensor_image(color), tensor_image(depth))
        return {"rgbd": rgbd, "filled": max(1, int(((depth > 0) & (depth < 1e3 * self.most)).sum()))}

    def looks(self, view):
        """ORB features of a view with depth: points in the camera, pixels, descriptors."""
        if "looks" not in view:
            import cv2
            color, depth = view["rgbd"].color.as_tensor().numpy(), view["rgbd"].depth.as_tensor().numpy().squeeze()
            points, described = cv2.ORB_create(1000).detectAndCompute(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), None)
            pixels = np.array([p.pt for p in points]).reshape(-1, 2)
            z = 1e-3 * depth[tuple(pixels.round().astype(int).T[::-1])] if len(pixels) else np.zeros(0)
            rays = (np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(self.intrinsic).T) * z[:, None]
            view["looks"] = rays, pixels, described, z > 0
        return view["looks"]

    def by_looks(self, source, target):
        """Motion from source to target by features, or nothing."""
        import cv2
        (points, _, a, filled), (_, pixels, b, _) = self.looks(source), self.looks(target)
        if a is None or b is None:
            return None
        pairs = [(m.queryIdx, m.trainIdx) for m in cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(a, b) if filled[m.queryIdx]]
        if len(pairs) < 12:
            return None
        i, j = np.array(pairs).T
        good, turn, place, inliers = cv2.solvePnPRansac(
            points[i], pixels[j], self.intrinsic, None, iterationsCount=1000, reprojectionError=3.0, confidence=0.999)
        if not good or inliers is None or len(inliers) < 12:
            return None
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = cv2.Rodrigues(turn)[0], place[:, 0]
        return motion


def placed(edges, count, apart):
    """Poses of the largest group that edges join: neighbours' edges first, if not apart, then those that agree in most pixels."""
    order = sorted(edges, key=lambda e: (not apart and e[1] - e[0] != 1, -edges[e][1][5, 5]))
    group, poses = list(range(count)), [{n: np.eye(4)} for n in range(count)]
    for s, t in order:
        a, b = group[s], group[t]
        if a != b:
            # The edge takes points of camera s to camera t.
            moved = poses[a][s] @ np.linalg.inv(edges[s, t][0]) @ np.linalg.inv(poses[b][t])
            for n, pose in poses[b].items():
                poses[a][n], group[n] = moved @ pose, a
            poses[b] = {}
    return max(poses, key=len)


def optimized(edges, poses, apart):
    """Poses after global optimization of the pose graph; edges of neighbours are certain, if views are not apart."""
    import open3d as o3d
    registration = o3d.pipelines.registration
    names = sorted(poses)
    index = {n: k for k, n in enumerate(names)}
    graph = registration.PoseGraph()
    for n in names:
        graph.nodes.append(registration.PoseGraphNode(poses[n]))
    for (s, t), (motion, information) in sorted(edges.items()):
        if s in index and t in index:
            graph.edges.append(registration.PoseGraphEdge(index[s], index[t], motion, information, uncertain=apart or t - s != 1))
    registration.global_optimization(
        graph, registration.GlobalOptimizationLevenbergMarquardt(), registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(
            max_correspondence_distance=0.07, edge_prune_threshold=0.25, preference_loop_closure=0.1, reference_node=0))
    return {n: np.array(graph.nodes[k].pose) for n, k in index.items()}


def graph(bag, quick=False):
    """Poses by stamp, `world_from_camera`, by odometry and a pose graph."""
    few = len(stamps_in(bag)) <= FEW
    every, short = 5 if few else 10, few and not quick
    stamps, keys, edges, last, odometry = [], {}, {}, None, None
    for at, color, depth, intrinsic in views(bag):
        if odometry is None:
            median, most = depth_range(depth)
            odometry = Odometry(intrinsic, most)
        n, view = len(stamps), odometry.view(color, depth)
        stamps.append(at)
        if last is not None:
            found = [odometry(last, view, np.eye(4))]
            if short or found[0] is None:
                start = odometry.by_looks(last, view)
                found.append(None if start is None else odometry(last, view, start))
            found = [f for f in found if f is not None]
            if found:
                edges[n - 1, n] = max(found, key=lambda f: f[1][5, 5])
        if short or n % every == 0:
            keys[n] = view
        last = view
    if short:
        for s in keys:
            for t in keys:
                start = odometry.by_looks(keys[s], keys[t]) if t > s + 1 else None
                edge = start is not None and odometry(keys[s], keys[t], start)
                if edge:
                    edges[s, t] = edge
    poses = placed(edges, len(stamps), short)
    if short:
        poses = optimized(edges, poses, short)
    names = [n for n in keys if n in poses]
    for s in names:
        for t in names:
            if t - s <= 1 or (s, t) in edges:
                continue
            # How far the middle of the view, at the median depth, moves and turns.
            start = np.linalg.inv(poses[t]) @ poses[s]
            middle = start @ [0, 0, median, 1]
            turned = np.degrees(np.arccos(np.clip((np.trace(start[:3, :3]) - 1) / 2, -1, 1)))
            if np.linalg.norm(middle[:3] - [0, 0, median]) < 0.3 * median and turned < 30:
                edge = odometry(keys[s], keys[t], start)
                if edge:
                    edges[s, t] = edge
    poses = optimized(edges, poses, short)
    print(f"{len(stamps)} views, {len(poses)} joined, {sum(t - s == 1 for s, t in edges)} edges of neighbours, "
          f"{sum(t - s != 1 for s, t in edges)} closures", file=sys.stderr)
    return {stamps[n]: pose for n, pose in poses.items()}


def work(method, bags):
    """Prints trajectories in the form of `artitwin track`."""
    from scipy.spatial.transform import Rotation
    import open3d as o3d
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    for state, bag in enumerate(bags):
        poses = {"graph": graph, "quick": lambda b: graph(b, True), "slam": slam}[method](bag) if method != "nothing" else {}
        print(f"# state {state}")
        for at, pose in sorted(poses.items()):
            u, _, v = np.linalg.svd(pose[:3, :3])
            print(f"{at:.9f}", *(f"{x:.9f}" for x in (*pose[:3, 3], *Rotation.from_matrix(u @ v).as_quat())))


# The comparison.


def run(command, kept=None):
    """Text of stdout, text of stderr, seconds, processor seconds, MB; of a process that ended before, what it left in `kept`."""
    if kept and kept.exists():
        return json.loads(kept.read_text())
    with tempfile.NamedTemporaryFile("r") as used:
        started = time.monotonic()
        ended = subprocess.run(["/usr/bin/time", "-f", "%M %U %S", "-o", used.name, *map(str, command)], capture_output=True, text=True, check=False)
        seconds = time.monotonic() - started
        peak, user, system = (float(x) for x in re.findall(r"[\d.]+", used.read())[-3:])
    result = ended.stdout, ended.stderr, seconds, user + system, peak / 1024
    if kept:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(result))
    return result


def measured(found, truth):
    """Errors of a state, or nothing where under three views are tracked."""
    from trajectory import compare
    return compare(found, truth) if len(found) >= 3 else None


def failed(errors, share):
    return errors is None or share < 0.5 or errors["ate_mm"] > 100


def make_dense(folder, synth):
    for name, options in DENSE.items():
        if not (folder / name / "truth.json").exists():
            subprocess.run([synth, "synth", "--out", folder / name, *DENSE_OPTIONS, *options], check=True, stdout=sys.stderr)


def main():
    if sys.argv[1:2] == ["work"]:
        return work(sys.argv[2], sys.argv[3:])
    # What the peers' processes need; without it each would count as a failure of its method.
    import cv2, open3d  # noqa: E401, F401
    from trajectory import nearest, read_poses
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bags", type=Path)
    parser.add_argument("--dense", type=Path)
    parser.add_argument("--artitwin", default="target/release/artitwin")
    parser.add_argument("--synth")
    parser.add_argument("--methods", default="artitwin,graph,quick,slam")
    parser.add_argument("--keep", type=Path, help="folder that keeps what every process printed and used; those there are not run again")
    parser.add_argument("--only-kept", action="store_true", help="table of what --keep holds; runs nothing")
    parser.add_argument("names", nargs="*")
    args = parser.parse_args()
    if args.dense and not args.only_kept:
        make_dense(args.dense, args.synth or args.artitwin)
    folders = [(f"dense/{n}", args.dense / n) for n in DENSE] if args.dense else []
    folders = [(n, args.bags / n) for n in FIRST] * bool(args.bags) + folders
    if args.names:
        known = dict(folders)
        folders = [(n, known.get(n) or args.bags / n) for n in args.names]
    methods = args.methods.split(",")
    idle = run([sys.executable, __file__, "work", "nothing"], args.keep and args.keep / "idle.json")
    print(f"{datetime.datetime.now():%Y-%m-%d %H:%M}, {os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}; load when started {os.getloadavg()[0]:.1f}.")
    print(f"Of the peers' figures, start of Python with Open3D: {idle[2]:.1f} s, {idle[3]:.1f} processor seconds, {idle[4]:.0f} MB.\n")
    print("| recording, state | views | method | tracked | ATE mm | ATE deg | RPE mm, deg | s a view | CPU s a view | MB |")
    print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    worse, sums = [], {m: [] for m in methods}
    for name, folder in folders:
        files = {m: args.keep and args.keep / f"{name.replace('/', '_')}.{m}.json" for m in methods}
        if args.only_kept and not any(f.exists() for f in files.values()):
            continue
        bags = [folder / s for s in ("state0", "state1")]
        truths = [true_poses(folder, k) for k in range(2)]
        stamps = [len(stamps_in(b)) for b in bags]
        results = {}
        for method in methods:
            if method == "quick" and max(stamps) > FEW or args.only_kept and not files[method].exists():
                continue
            command = [args.artitwin, "track", *bags] if method == "artitwin" else [sys.executable, __file__, "work", method, *bags]
            text, told, seconds, cpu, peak = run(command, files[method])
            found = [nearest(s, t) for s, t in zip(read_poses(text), truths)]
            found += [{}] * (2 - len(found))
            results[method] = found, seconds / sum(stamps), cpu / sum(stamps), peak
        for state, truth in enumerate(truths):
            for method, (found, seconds, cpu, peak) in results.items():
                share, errors = len(found[state]) / stamps[state], measured(found[state], truth)
                mark = "F " * failed(errors, share)
                shown = " | | " if errors is None else f"{errors['ate_mm']:.2f} | {errors['ate_deg']:.3f} | {errors['rpe_mm']:.2f}, {errors['rpe_deg']:.3f}"
                print(f"| {name} {state} | {stamps[state]} | {method} | {mark}{len(found[state])} ({share:.0%}) | {shown} | {seconds:.3f} | {cpu:.3f} | {peak:.0f} |", flush=True)
                sums[method].append((share, not failed(errors, share)))
            if "artitwin" not in results:
                continue
            ours = results["artitwin"]
            for method in results:
                if method == "artitwin":
                    continue
                theirs = results[method]
                a, b = ours[0][state], theirs[0][state]
                common = [t for t in a if t in b and t in truth]
                lost = failed(measured(b, truth), len(b) / stamps[state])
                mark = " (F)" if lost else ""
                if len(a) < len(b):
                    worse.append(f"{name} {state}: tracked, {len(a)} of {stamps[state]}; {method}{mark} {len(b)}")
                if len(common) >= 3:
                    x, y = measured({t: a[t] for t in common}, truth), measured({t: b[t] for t in common}, truth)
                    for key, unit in (("ate_mm", "ATE, mm"), ("ate_deg", "ATE, deg"), ("rpe_mm", "RPE, mm"), ("rpe_deg", "RPE, deg")):
                        if x[key] > y[key]:
                            worse.append(f"{name} {state}: {unit}: {x[key]:.3f}; {method}{mark} {y[key]:.3f} ({len(common)} views in common)")
                if state == 0:
                    for k, unit in ((1, "s a view"), (2, "CPU s a view"), (3, "MB")):
                        if ours[k] > theirs[k]:
                            worse.append(f"{name}: {unit}: {ours[k]:.3f}; {method}{mark} {theirs[k]:.3f}")
    print()
    for method, rows in sums.items():
        if not rows:
            continue
        print(f"- {method}: {sum(ok for _, ok in rows)} of {len(rows)} states not failed, {np.mean([s for s, _ in rows]):.1%} of the views tracked (mean over states).")
    print("\nWhere artitwin is worse, errors over the views in common (`F`: the peer failed on that state):\n")
    print("\n".join(f"- {w}" for w in worse) or "- nowhere")


if __name__ == "__main__":
    main()
