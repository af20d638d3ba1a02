"""A finished twin: its joints, which end of each is closed, its solids as planes, poses of its parts.

Positions in m and rad, in the world frame of the twin.
"""
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

SLIDE, HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
# Largest MJCF that is read, bytes; a twin's has 30 kB.
LARGEST = 16 << 20
# What the names of robot, floor and ball begin with.
OURS = "demo_"
# Contact bits: what stands in the world of the twin, and the floor, which the twin itself does not feel.
BODIES, FLOOR = 1, 2


class Refused(Exception):
    """Why the demonstration cannot be given."""


@dataclass
class Joint:
    """A joint of the twin; `pitch` is 0 but for a screw."""

    name: str
    body: str
    kind: str
    closed: float
    open: float
    pitch: float
    # Shares of the range at which the recording showed it.
    recorded: tuple = ()

    @property
    def range(self):
        return abs(self.open - self.closed)

    def share(self, q):
        """How far open a position is: 0 closed, 1 open."""
        return (q - self.closed) / (self.open - self.closed)

    def at(self, share):
        return self.closed + share * (self.open - self.closed)


def mjcf_of(folder):
    """The MJCF of a run's folder: the one file that holds bodies and includes no other."""
    found = []
    for path in sorted(Path(folder).glob("*.xml")):
        if path.stat().st_size > LARGEST:
            raise Refused(f"{path} has more than {LARGEST} bytes")
        text = path.read_text(errors="replace")
        if "<mujoco" in text and "<worldbody" in text and "<include" not in text:
            found.append(path)
    if len(found) != 1:
        raise Refused(f"{folder} holds {len(found)} MJCF files with bodies; give the folder of a finished run")
    return found[0]


def load(path):
    """The twin's MJCF without its keyframes, which hold no positions of what is added to it, compiled, and the positions
    in the states that the recording showed."""
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        states = [list(key.qpos) for key in spec.keys if key.name.startswith("state")]
        for key in list(spec.keys):
            spec.delete(key)
        model = spec.copy().compile()
    except ValueError as error:
        raise Refused(f"MuJoCo cannot read {path}: {error}") from error
    if mujoco.mjtJoint.mjJNT_FREE in model.jnt_type:
        raise Refused("the twin's base floats and would be pulled along; give a twin whose base is fixed")
    if any(name.startswith(OURS) for name in names(model)):
        raise Refused(f"names that begin with {OURS} are those of the robot")
    return spec, model, [s for s in states if len(s) == model.nq]


def names(model):
    """Names of bodies, joints and geoms."""
    yield from (model.body(k).name for k in range(model.nbody))
    yield from (model.joint(k).name for k in range(model.njnt))
    yield from (model.geom(k).name for k in range(model.ngeom))


def threads_of(model):
    """Screws: the joint that turns, the one that slides, and the way of a radian; whichever of the two follows."""
    for e in range(model.neq):
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT:
            follower, leader, way = int(model.eq_obj1id[e]), int(model.eq_obj2id[e]), float(model.eq_data[e][1])
            if model.jnt_type[follower] == HINGE:
                yield follower, leader, 1 / way
            else:
                yield leader, follower, way


def joints_of(model, states):
    """The joints of a bare twin, parents first; `states`: positions as recorded."""
    threads = {turn: (slide, pitch) for turn, slide, pitch in threads_of(model)}
    followers = {slide for slide, _ in threads.values()}
    data, found = mujoco.MjData(model), []
    for j in range(model.njnt):
        if j in followers or model.jnt_type[j] not in (SLIDE, HINGE):
            continue
        lower, upper = map(float, model.jnt_range[j])
        if not lower < upper:
            raise Refused(f"{model.joint(j).name} has no interval to move through")
        pitch = threads[j][1] if j in threads else 0.0
        kind = "screw" if j in threads else "hinge" if model.jnt_type[j] == HINGE else "slide"
        body = int(model.jnt_bodyid[j])
        near = [_distance(model, data, j, body, q) for q in (lower, upper)]
        ends = (lower, upper) if near[0] <= near[1] else (upper, lower)
        joint = Joint(model.joint(j).name, model.body(body).name, kind, *ends, pitch)
        joint.recorded = tuple(joint.share(s[model.jnt_qposadr[j]]) for s in states)
        found.append(joint)
    if not found:
        raise Refused("the twin has no joint")
    return found


def _distance(model, data, joint, body, q):
    """How far the moving part's middle is from its parent's: the part is closed where that is least."""
    mujoco.mj_resetData(model, data)
    place(model, data, {model.joint(joint).name: q})
    middles = []
    for b in (body, int(model.body_parentid[body])):
        if not solids(model, b):
            raise Refused(f"{model.body(b).name} has no collision solid")
        points = np.concatenate([vertices(model, data, g) for g in solids(model, b)])
        middles.append((points.min(0) + points.max(0)) / 2)
    return float(np.linalg.norm(middles[0] - middles[1]))


def place(model, data, positions):
    """Sets joints by name, and the slides of screws with them."""
    for name, q in positions.items():
        data.joint(name).qpos[0] = q
    for turn, slide, pitch in threads_of(model):
        data.qpos[model.jnt_qposadr[slide]] = pitch * data.qpos[model.jnt_qposadr[turn]]
    mujoco.mj_forward(model, data)


def solids(model, body):
    """The meshes of a body that touch others."""
    mesh = int(mujoco.mjtGeom.mjGEOM_MESH)
    return [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_contype[g] and model.geom_type[g] == mesh]


def below(model, body):
    """A body and all that hang on it."""
    found = [body]
    for b in range(body + 1, model.nbody):
        if int(model.body_parentid[b]) in found:
            found.append(b)
    return found


def vertices(model, data, geom):
    """Corners of a mesh geom in the world, n x 3."""
    mesh = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[first : first + count]
    return corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def planes(model, data, geom):
    """Planes of a convex solid in the world: outer normals, n x 3, their offsets, n, and the areas of its faces, n."""
    mesh = int(model.geom_dataid[geom])
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    corners = vertices(model, data, geom)
    a, b, c = (corners[model.mesh_face[first : first + count, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    keep = length > 1e-12
    normals, a = normals[keep] / length[keep, None], a[keep]
    # Outward, whatever the winding.
    flip = np.einsum("ij,ij->i", normals, a - corners.mean(0)) < 0
    normals[flip] *= -1
    return normals, np.einsum("ij,ij->i", normals, a), length[keep] / 2


def moved(joint, axis, anchor, by):
    """The rigid motion of a part when its joint moves: rotation and translation, of the axis in the world."""
    if joint.kind == "slide":
        return np.eye(3), axis * by
    rotation = turn(axis, by)
    return rotation, anchor - rotation @ anchor + axis * by * joint.pitch


def front(model, data, joints):
    """The level direction that most parts open to, unit length."""
    total = np.zeros(3)
    for joint in joints:
        j, body = model.joint(joint.name).id, model.joint(joint.name).bodyid[0]
        axis = np.sign(joint.open - joint.closed) * data.xaxis[j]
        way = axis if joint.kind == "slide" else np.cross(axis, data.xipos[body] - data.xanchor[j])
        total += way / max(np.linalg.norm(way), 1e-9)
    total[2] = 0
    length = np.linalg.norm(total)
    return total / length if length > 0.3 else np.array([1.0, 0, 0])


def turn(axis, angle):
    """The rotation about a unit axis."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def rotation_vector(rotation):
    """Axis times angle of a rotation matrix."""
    quaternion, vector = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, rotation.flatten())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def quaternion_of(rotation):
    """w, x, y, z of a rotation matrix."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).flatten())
    return quaternion
