"""Loads a URDF in MuJoCo and PyBullet, moves every joint and checks that the right links move by the right transform.

    python check_urdf.py URDF [--poses FILE] [--pictures DIR]

What is right comes from FILE, which another program wrote from its own model:
    {"links": [name], "joints": [name], "poses": [{"joints": {name: position}, "world_from_link": {link: 4x4}}]}
and, for the moves of single joints, from the kinematics of the URDF text as read here. Prints a JSON summary; any
mismatch is an error. Pictures: one per simulator and pose; MuJoCo's need EGL or OSMesa and are left out, with a line
on stderr, where neither works.
"""

import argparse
import json
import os
import struct
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zlib
from pathlib import Path


def off_screen():
    """The way in which MuJoCo can draw here; None where there is none. A failed try cannot be taken back in a process."""
    wanted = os.environ.get("MUJOCO_GL")
    for way in [wanted] if wanted else ["egl", "osmesa"]:
        program = "import mujoco; mujoco.GLContext(8, 8).make_current()"
        done = subprocess.run([sys.executable, "-c", program], env={**os.environ, "MUJOCO_GL": way}, capture_output=True)
        if done.returncode == 0:
            return way
    return None


import numpy as np
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

TOLERANCE_M = 2e-5
SIZE = (480, 360)


def numbers(element, name, default):
    text = element.get(name, default) if element is not None else default
    return np.array([float(x) for x in text.split()])


def transform(rotation, translation):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, translation
    return out


def moved(points, pose):
    return points @ pose[:3, :3].T + pose[:3, 3]


class Urdf:
    """What the text says."""

    def __init__(self, path):
        robot = ElementTree.parse(path).getroot()
        self.joints = {j.get("name"): j for j in robot.findall("joint")}
        self.carrier = {j.find("child").get("link"): j for j in self.joints.values()}
        self.points = {}
        for link in robot.findall("link"):
            files = [mesh.get("filename") for mesh in link.iterfind("visual/geometry/mesh")]
            assert all(not f.startswith("/") and ".." not in f for f in files), files
            meshes = [trimesh.load_mesh(path.parent / f, process=False) for f in files]
            self.points[link.get("name")] = np.concatenate([m.vertices for m in meshes])
        assert not set(self.joints) & set(self.points), "a link and a joint share a name"

    def world_from_link(self, link, positions):
        joint = self.carrier.get(link)
        if joint is None:
            return np.eye(4)
        origin, position = joint.find("origin"), positions.get(joint.get("name"), 0.0)
        fixed = transform(Rotation.from_euler("xyz", numbers(origin, "rpy", "0 0 0")).as_matrix(), numbers(origin, "xyz", "0 0 0"))
        axis = numbers(joint.find("axis"), "xyz", "1 0 0")
        if joint.get("type") == "prismatic":
            step = transform(np.eye(3), axis * position)
        else:
            step = transform(Rotation.from_rotvec(axis * position).as_matrix(), np.zeros(3))
        return self.world_from_link(joint.find("parent").get("link"), positions) @ fixed @ step

    def limits(self, name):
        limit = self.joints[name].find("limit")
        assert all(limit.get(k) is not None for k in ("lower", "upper", "effort", "velocity")), name
        return float(limit.get("lower")), float(limit.get("upper"))

    def moved_by(self, name):
        """Links that hang on a joint."""
        out, grew = {self.joints[name].find("child").get("link")}, True
        while grew:
            more = {child for child, j in self.carrier.items() if j.find("parent").get("link") in out} - out
            out, grew = out | more, bool(more)
        return out


class MuJoCo:
    name = "mujoco"

    def __init__(self, path):
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        ids = {self.model.body(b).name: b for b in range(1, self.model.nbody)}
        self.links, self.bodies = list(ids), ids
        self.joints = [self.model.joint(j).name for j in range(self.model.njnt)]

    def masses(self):
        return {link: float(self.model.body_mass[b]) for link, b in self.bodies.items()}

    def set(self, positions):
        for name, position in positions.items():
            self.data.joint(name).qpos[0] = position
        self.mujoco.mj_forward(self.model, self.data)

    def points(self, link):
        """World vertices of everything that is drawn of a link."""
        out = []
        for g in np.flatnonzero(self.model.geom_bodyid == self.bodies[link]):
            mesh = self.model.mesh(self.model.geom_dataid[g])
            start = int(mesh.vertadr[0])
            vertices = self.model.mesh_vert[start : start + int(mesh.vertnum[0])]
            out.append(moved(vertices, transform(self.data.geom_xmat[g].reshape(3, 3), self.data.geom_xpos[g])))
        return np.concatenate(out)

    def contacts(self):
        return int(self.data.ncon)

    def picture(self, center, radius):
        camera = self.mujoco.MjvCamera()
        camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = center, 3.2 * radius, 145, -25
        self.model.vis.headlight.ambient[:] = 0.4
        with self.mujoco.Renderer(self.model, SIZE[1], SIZE[0]) as renderer:
            renderer.update_scene(self.data, camera)
            return renderer.render()


class PyBullet:
    name = "pybullet"

    def __init__(self, path):
        import pybullet

        self.p = pybullet
        self.p.connect(self.p.DIRECT)
        self.body = self.p.loadURDF(str(path), useFixedBase=True, flags=self.p.URDF_USE_INERTIA_FROM_FILE)
        info = [self.p.getJointInfo(self.body, j) for j in range(self.p.getNumJoints(self.body))]
        root = self.p.getBodyInfo(self.body)[0].decode()
        self.index = {root: -1} | {i[12].decode(): i[0] for i in info}
        self.links, self.joints = list(self.index), [i[1].decode() for i in info]
        self.drawn = {link: [] for link in self.links}
        for shape in self.p.getVisualShapeData(self.body):
            link = next(name for name, i in self.index.items() if i == shape[1])
            vertices = trimesh.load_mesh(shape[4].decode(), process=False).vertices * np.array(shape[3])
            self.drawn[link].append(moved(vertices, self.pose(shape[5], shape[6])))

    @staticmethod
    def pose(position, quaternion):
        return transform(Rotation.from_quat(quaternion).as_matrix(), position)

    def masses(self):
        """Without the base: a fixed one has the mass 0 here."""
        return {link: self.p.getDynamicsInfo(self.body, i)[0] for link, i in self.index.items() if i >= 0}

    def set(self, positions):
        for name, position in positions.items():
            self.p.resetJointState(self.body, self.joints.index(name), position)

    def points(self, link):
        index = self.index[link]
        if index < 0:
            # The base is placed by its center of mass.
            inertial = self.pose(*self.p.getDynamicsInfo(self.body, -1)[3:5])
            frame = self.pose(*self.p.getBasePositionAndOrientation(self.body)) @ np.linalg.inv(inertial)
        else:
            frame = self.pose(*self.p.getLinkState(self.body, index, computeForwardKinematics=True)[4:6])
        return moved(np.concatenate(self.drawn[link]), frame)

    def contacts(self):
        self.p.performCollisionDetection()
        return len(self.p.getContactPoints(self.body, self.body))

    def picture(self, center, radius):
        view = self.p.computeViewMatrixFromYawPitchRoll(list(center), 3.2 * radius, 55, -25, 0, 2)
        projection = self.p.computeProjectionMatrixFOV(45, SIZE[0] / SIZE[1], 0.01, 20 * radius)
        image = self.p.getCameraImage(*SIZE, view, projection, renderer=self.p.ER_TINY_RENDERER)[2]
        return np.reshape(image, (SIZE[1], SIZE[0], 4))[:, :, :3].astype(np.uint8)


def png(image):
    height, width = image.shape[:2]
    rows = b"".join(b"\0" + row.tobytes() for row in np.ascontiguousarray(image, dtype=np.uint8))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def gap(a, b):
    """Largest distance from a point of either set to the other; importers merge and reorder vertices."""
    return float(max(KDTree(b).query(a)[0].max(), KDTree(a).query(b)[0].max()))


def check(simulator, urdf, expected):
    assert sorted(simulator.links) == sorted(urdf.points), (simulator.links, list(urdf.points))
    assert sorted(simulator.joints) == sorted(urdf.joints), (simulator.joints, list(urdf.joints))
    if expected:
        assert sorted(expected["links"]) == sorted(simulator.links) and sorted(expected["joints"]) == sorted(simulator.joints)
    zero, worst = {name: 0.0 for name in urdf.joints}, 0.0
    for pose in expected["poses"] if expected else []:
        simulator.set(zero | pose["joints"])
        for link, matrix in pose["world_from_link"].items():
            worst = max(worst, gap(simulator.points(link), moved(urdf.points[link], np.array(matrix))))
    assert worst < TOLERANCE_M, f"{simulator.name}: links are {worst} m from their poses"
    travel = {}
    for name in urdf.joints:
        lower, upper = urdf.limits(name)
        simulator.set(zero | {name: lower})
        before = {link: simulator.points(link) for link in urdf.points}
        simulator.set(zero | {name: upper})
        travel[name] = 0.0
        for link in urdf.points:
            step = urdf.world_from_link(link, {name: upper}) @ np.linalg.inv(urdf.world_from_link(link, {name: lower}))
            error = float(np.abs(simulator.points(link) - moved(before[link], step)).max())
            assert error < TOLERANCE_M, f"{simulator.name}: {name} moves {link} wrongly by {error} m"
            distance = float(np.linalg.norm(simulator.points(link) - before[link], axis=1).max())
            assert (distance > 1e-3) == (link in urdf.moved_by(name)), f"{simulator.name}: {name} moves {link} by {distance} m"
            travel[name] = max(travel[name], distance)
    simulator.set(zero)
    return {"links": len(simulator.links), "joints": len(simulator.joints), "masses": simulator.masses(), "contacts": simulator.contacts(), "worst_m": worst, "travel_m": travel}


def draw(simulator, urdf, poses, folder):
    for k, positions in enumerate(poses):
        simulator.set(positions)
        points = np.concatenate([simulator.points(link) for link in urdf.points])
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        radius = np.linalg.norm(points.max(axis=0) - points.min(axis=0)) / 2
        image = simulator.picture(center, radius)
        shown = float((image != image[0, 0]).any(axis=2).mean())
        assert 0.02 < shown < 0.9, f"{simulator.name}: {100 * shown:.0f} % of the picture shows the object"
        (folder / f"{simulator.name}_{k}.png").write_bytes(png(image))


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("urdf", type=Path)
    arguments.add_argument("--poses", type=Path)
    arguments.add_argument("--pictures", type=Path)
    options = arguments.parse_args()
    urdf = Urdf(options.urdf)
    expected = json.loads(options.poses.read_text()) if options.poses else None
    summary, way = {}, off_screen() if options.pictures else None
    # Read by MuJoCo when it is imported.
    os.environ["MUJOCO_GL"] = way or "disable"
    for kind in (MuJoCo, PyBullet):
        simulator = kind(options.urdf)
        summary[simulator.name] = check(simulator, urdf, expected)
        if options.pictures and kind is MuJoCo and not way:
            print("no MuJoCo pictures: neither EGL nor OSMesa works here", file=sys.stderr)
        elif options.pictures:
            options.pictures.mkdir(parents=True, exist_ok=True)
            poses = [p["joints"] for p in expected["poses"]] if expected else [{name: urdf.limits(name)[k] for name in urdf.joints} for k in (0, 1)]
            draw(simulator, urdf, poses, options.pictures)
    # Simulators print to stdout as well: the summary is the last line.
    print(json.dumps(summary))


if __name__ == "__main__":
    main()
