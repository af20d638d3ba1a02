"""Independent scorer: measures a run's files against the truth and prints JSON.

    python evaluate.py TRUTH RUN

Written from the definitions of the metrics, without code in common with the crate, so that the two check each other:
axis angle with the sign ignored; distance of the axes as lines; whole rotation between the motions, or the difference of
the translations; Chamfer distance of 10,000 area samples a side, squared, both directions summed, times 1000; mean exact
distances from the found surface to the true one and from the seen true points to the found surface.
"""

import itertools
import json
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

SAMPLES = 10_000


def numbers(element, name, default):
    return np.array([float(x) for x in (element.get(name) or default).split()]) if element is not None else np.fromstring(default, sep=" ")


def matrix(element):
    """target_from_source of an <origin>."""
    out = np.eye(4)
    if element is not None:
        out[:3, :3] = Rotation.from_euler("xyz", numbers(element, "rpy", "0 0 0")).as_matrix()
        out[:3, 3] = numbers(element, "xyz", "0 0 0")
    return out


class Run:
    """Links, joints and the joint positions of both states. Handles fixed, revolute, continuous and prismatic."""

    def __init__(self, folder):
        (path,) = [p for p in folder.glob("*.urdf") if not p.name.endswith(".ros.urdf")]
        robot = ElementTree.parse(path).getroot()
        self.meshes = {link.get("name"): self.mesh(folder, link) for link in robot.iter("link")}
        self.joints = {j.find("child").get("link"): j for j in robot.findall("joint")}
        self.states = [s["joints"] for s in json.loads((folder / "report.json").read_text())["states"]]
        (self.root,) = set(self.meshes) - set(self.joints)

    @staticmethod
    def mesh(folder, link):
        parts = []
        for visual in link.findall("visual"):
            mesh = trimesh.load_mesh(folder / visual.find("geometry/mesh").get("filename"), process=False)
            parts.append(mesh.apply_transform(matrix(visual.find("origin"))))
        return trimesh.util.concatenate(parts)

    def frame(self, link, state):
        """world_from_joint of the joint that carries the link."""
        joint = self.joints[link]
        return self.pose(joint.find("parent").get("link"), state) @ matrix(joint.find("origin"))

    def pose(self, link, state):
        """world_from_link."""
        if link == self.root:
            return np.eye(4)
        joint, step = self.joints[link], np.eye(4)
        axis = self.axis(joint)
        position = self.states[state].get(joint.get("name"), 0.0)
        if joint.get("type") in ("revolute", "continuous"):
            step[:3, :3] = Rotation.from_rotvec(axis * position).as_matrix()
        elif joint.get("type") == "prismatic":
            step[:3, 3] = axis * position
        return self.frame(link, state) @ step

    @staticmethod
    def axis(joint):
        axis = numbers(joint.find("axis"), "xyz", "1 0 0")
        return axis / np.linalg.norm(axis)

    def motion(self, link):
        return self.pose(link, 1) @ np.linalg.inv(self.pose(link, 0))

    def surface(self, links, state):
        return trimesh.util.concatenate([self.meshes[link].copy().apply_transform(self.pose(link, state)) for link in links])


def moved(points, transform):
    return points @ transform[:3, :3].T + transform[:3, 3]


def line_gap(point_a, axis_a, point_b, axis_b):
    """Least squares over the parameters of both lines; parallel lines are covered by the pseudo-inverse."""
    between = point_b - point_a
    directions = np.stack([axis_a, -axis_b], axis=1)
    return np.linalg.norm(between - directions @ (np.linalg.pinv(directions, rcond=1e-6) @ between))


def joint_row(run, link, part, error):
    joint, motion = run.joints[link], run.motion(link)
    frame, truth = run.frame(link, 0), np.array(part["state1_from_state0"])
    axis, true_axis = frame[:3, :3] @ run.axis(joint), np.array(part["axis"])
    true_axis = true_axis / np.linalg.norm(true_axis)
    kind = "revolute" if joint.get("type") == "continuous" else joint.get("type")
    row = {"part": part["name"], "type_true": part["type"], "type": kind, "type_right": kind == part["type"]}
    row["axis_deg"] = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, true_axis)), abs(axis @ true_axis))))
    row["error_mm"] = 1000 * error
    if part["type"] == "prismatic":
        row["motion_mm"] = 1000 * float(np.linalg.norm(motion[:3, 3] - truth[:3, 3]))
    else:
        row["axis_mm"] = 1000 * float(line_gap(frame[:3, 3], axis, np.array(part["origin"]), true_axis))
        row["motion_deg"] = float(np.degrees(Rotation.from_matrix(motion[:3, :3] @ truth[:3, :3].T).magnitude()))
    return row


def match(run, truth_dir, wanted):
    """The assignment of movable links to movable true parts with the smallest sum of mean vertex displacements."""
    links = [link for link in run.meshes if link != run.root]
    cost = np.empty((len(wanted), len(links)))
    for i, part in enumerate(wanted):
        points = trimesh.load_mesh(truth_dir / f"truth/state0/part_{part['index']}.ply", process=False).vertices
        there = moved(points, np.array(part["state1_from_state0"]))
        for k, link in enumerate(links):
            cost[i, k] = np.linalg.norm(moved(points, run.motion(link)) - there, axis=1).mean()
    columns = min(itertools.permutations(range(len(links)), len(wanted)), key=lambda p: sum(cost[i, k] for i, k in enumerate(p)))
    return [(links[k], cost[i, k]) for i, k in enumerate(columns)]


def sampled(mesh, seed):
    return trimesh.sample.sample_surface(mesh, SAMPLES, seed=seed)[0]


def chamfer(a, b):
    return 1000 * float(np.mean(KDTree(b).query(a)[0] ** 2) + np.mean(KDTree(a).query(b)[0] ** 2))


def mean_distance_mm(points, mesh):
    """Exact, through an R-tree over the triangles."""
    return 1000 * float(np.mean(trimesh.proximity.closest_point(mesh, points)[1]))


def mesh_row(found, true, seen):
    samples = sampled(found, 11)
    row = {
        "cd": chamfer(samples, sampled(true, 12)),
        "cd_floor": chamfer(sampled(true, 13), sampled(true, 14)),
        "accuracy_mm": mean_distance_mm(samples, true),
        "area_m2": float(true.area),
    }
    if len(seen):
        row["seen_mm"] = mean_distance_mm(seen, found)
    return row


def evaluate(truth_dir, run_dir):
    parts = json.loads((truth_dir / "truth.json").read_text())["parts"]
    run = Run(run_dir)
    wanted = [p for p in parts if p["type"] != "fixed"]
    matched = match(run, truth_dir, wanted)
    joints = [joint_row(run, link, part, error) for part, (link, error) in zip(wanted, matched)]
    (static,) = [p["index"] for p in parts if p["type"] == "fixed"]
    surfaces = {"static": (static, [run.root]), "whole": (None, list(run.meshes))}
    surfaces |= {part["name"]: (part["index"], [link]) for part, (link, _) in zip(wanted, matched)}
    mesh = {}
    for state, (name, (index, links)) in itertools.product((0, 1), surfaces.items()):
        folder = truth_dir / f"truth/state{state}"
        true = trimesh.load_mesh(folder / ("whole.ply" if index is None else f"part_{index}.ply"), process=False)
        seen = np.load(folder / "seen.npy")[::4] if (folder / "seen.npy").exists() else np.empty((0, 4))
        seen = seen[:, :3] if index is None else seen[seen[:, 3] == index, :3]
        mesh[f"state{state}/{name}"] = mesh_row(run.surface(links, state), true, seen)
    return {"parts_true": len(parts), "parts_found": len(run.meshes), "joints": joints, "mesh": mesh}


if __name__ == "__main__":
    json.dump(evaluate(Path(sys.argv[1]), Path(sys.argv[2])), sys.stdout, indent=1)
