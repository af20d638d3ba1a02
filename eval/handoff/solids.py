"""How well the collision solids of finished runs stand where the eye sees the surface.

    python solids.py RUN [RUN ...] [--json FILE]

A table, one row a run, with the object as in its last observed state:
  front 2, 3  share of rays from outside onto the visible surface that meet a solid more than 2 or 3 mm
              before it (across the surface; rays within 60 degrees of its normal, 13 directions)
  none        share of those rays behind which no solid comes within 10 mm
  p95         95th percentile of the distance from a part's visual surface to its solids, mm (worst part)
  solids      per part
  rest        how far above the visible surface balls and boxes rest that are dropped on the twin in MuJoCo,
              mm, median and worst; through: those that pass into the surface; moved: largest change of a
              joint's position, rad or m

Needs numpy, trimesh, open3d, scipy, mujoco.
"""
import argparse
import json
import time
from pathlib import Path

import mujoco
import numpy as np
import open3d as o3d
import trimesh
from scipy.spatial import ConvexHull

GRID = 160
COS = 0.5
BEHIND_M = 0.010
DROPS = 20


def load(path):
    mesh = trimesh.load(path, process=False, force="mesh")
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces)


def scene(meshes):
    found = o3d.t.geometry.RaycastingScene()
    for points, faces in meshes:
        found.add_triangles(o3d.core.Tensor(points.astype(np.float32)), o3d.core.Tensor(faces.astype(np.uint32)))
    return found


def distance(at, points):
    return at.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def moved(mesh, pose):
    return mesh[0] @ pose[:3, :3].T + pose[:3, 3], mesh[1]


class Twin:
    def __init__(self, run):
        run = Path(run)
        self.report = json.loads((run / "report.json").read_text())
        self.mjcf = next(p for p in run.glob("*.xml") if p.name != "package.xml")
        self.links = [link["name"] for link in self.report["links"]]
        self.visual = {n: load(run / f"meshes/visual/{n}.obj") for n in self.links}
        self.solids = {}
        for n in self.links:
            files = sorted((run / "meshes/collision").glob(f"{n}_solid_*.obj"))
            hulls = [ConvexHull(load(f)[0]) for f in files]
            # Faces of a hull as it comes turn any way; distances and first hits do not mind.
            self.solids[n] = [(h.points, h.simplices, h.equations) for h in hulls]
        self.state = self.report["states"][-1]["joints"]

    def set_state(self, model, data, positions):
        for name, q in positions.items():
            data.joint(name).qpos[0] = q
        for e in range(model.neq):
            if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT:
                leader = model.jnt_qposadr[model.eq_obj2id[e]]
                follower = model.jnt_qposadr[model.eq_obj1id[e]]
                data.qpos[follower] = model.eq_data[e][1] * data.qpos[leader]
        mujoco.mj_forward(model, data)

    def poses(self):
        model = mujoco.MjModel.from_xml_path(str(self.mjcf))
        data = mujoco.MjData(model)
        self.set_state(model, data, self.state)
        found = {}
        for n in self.links:
            pose = np.eye(4)
            pose[:3, :3] = data.body(n).xmat.reshape(3, 3)
            pose[:3, 3] = data.body(n).xpos
            found[n] = pose
        return found


def directions():
    """Along the axes but from below, and along the eight diagonals."""
    axes = [np.array(d, float) for d in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1)]]
    diagonals = [np.array([x, y, z], float) / 3**0.5 for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    return axes + diagonals


def rays(lower, upper, direction):
    centre, radius = 0.5 * (lower + upper), 0.5 * np.linalg.norm(upper - lower) + 0.02
    across = np.linalg.svd(direction[None])[2][1:]
    grid = np.stack(np.meshgrid(*[np.linspace(-radius, radius, GRID)] * 2), -1).reshape(-1, 2)
    start = centre - 2 * radius * direction + grid @ across
    return np.concatenate([start, np.broadcast_to(direction, start.shape)], 1).astype(np.float32)


def fronts(twin, poses):
    visual = {n: moved(m, poses[n]) for n, m in twin.visual.items()}
    solids = {n: [moved(s, poses[n]) for s in all_] for n, all_ in twin.solids.items()}
    of = {}
    seen = scene([])
    for n, mesh in visual.items():
        of[int(seen.add_triangles(o3d.core.Tensor(mesh[0].astype(np.float32)),
                                  o3d.core.Tensor(mesh[1].astype(np.uint32))))] = n
    stand = scene([s for all_ in solids.values() for s in all_])
    points = np.concatenate([m[0] for m in visual.values()])
    all_off, all_hit, all_id = [], [], []
    for direction in directions():
        cast = o3d.core.Tensor(rays(points.min(0), points.max(0), direction))
        first = seen.cast_rays(cast)
        t, normal = first["t_hit"].numpy(), first["primitive_normals"].numpy()
        # The back of a surface is seen where nothing was seen of what hides it.
        cosine = -normal @ direction
        keep = np.isfinite(t) & (cosine > COS)
        off = (t[keep] - stand.cast_rays(cast)["t_hit"].numpy()[keep]) * cosine[keep]
        all_off.append(off)
        all_id.append(first["geometry_ids"].numpy()[keep])
    off, ids = np.concatenate(all_off), np.concatenate(all_id)

    def row(o):
        return [float((o > 2e-3).mean()), float((o > 3e-3).mean()), float((o < -BEHIND_M).mean())] if len(o) else [0.0] * 3

    return row(off), {n: row(off[ids == k]) for k, n in of.items()}


def to_solids(twin, name, count=20000):
    points, faces = twin.visual[name]
    samples = trimesh.sample.sample_surface(trimesh.Trimesh(points, faces, process=False), count, seed=0)[0]
    if not twin.solids[name]:
        return np.full(count, np.inf)
    out = distance(scene([s[:2] for s in twin.solids[name]]), samples)
    for s in twin.solids[name]:
        out[(samples @ s[2][:, :3].T + s[2][:, 3]).max(1) <= 0] = 0
    return out


def drops(twin, poses, hold):
    surface = scene([moved(m, poses[n]) for n, m in twin.visual.items()])
    points = np.concatenate([moved(m, poses[n])[0] for n, m in twin.visual.items()])
    lower, upper = points.min(0), points.max(0)
    size = np.linalg.norm(upper - lower)
    radius = max(0.006, 0.022 * size)
    draw = np.random.default_rng(3)
    spec = mujoco.MjSpec.from_file(str(twin.mjcf))
    for key in list(spec.keys):
        spec.delete(key)
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1],
                            pos=[0, 0, lower[2] - 0.001])
    count = 0
    while count < DROPS:
        xy = draw.uniform(lower[:2], upper[:2])
        down = np.array([[*xy, upper[2] + 0.5, 0, 0, -1]], np.float32)
        hit = surface.cast_rays(o3d.core.Tensor(down))["t_hit"].numpy()[0]
        if not np.isfinite(hit):
            continue
        body = spec.worldbody.add_body(name=f"o{count}", pos=[*xy, upper[2] + 0.5 - hit + radius + 0.03 * size + 0.01])
        body.add_freejoint()
        ball = count % 2 == 0
        kind = mujoco.mjtGeom.mjGEOM_SPHERE if ball else mujoco.mjtGeom.mjGEOM_BOX
        geom = body.add_geom(type=kind, size=[radius * (1 if ball else 0.8)] * 3, mass=0.02, condim=6,
                             friction=[0.6, 0.02, 0.004])
        geom.contype, geom.conaffinity, geom.priority = 2, 1, 1
        # Stiff, so that what is measured is the solids and not MuJoCo's soft contact.
        geom.solref, geom.solimp = [0.005, 1], [0.95, 0.99, 0.001, 0.5, 2]
        count += 1
    model = spec.compile()
    data = mujoco.MjData(model)
    twin.set_state(model, data, twin.state)
    bodies = [model.body(f"o{i}").id for i in range(DROPS)]
    closest = np.full(DROPS, np.inf)
    is_own = model.jnt_type != mujoco.mjtJoint.mjJNT_FREE
    own = model.jnt_qposadr[is_own]
    at = data.qpos[own].copy()
    for step in range(int(5 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        if hold:
            data.qpos[own], data.qvel[model.jnt_dofadr[is_own]] = at, 0
        if step % 8 == 0:
            closest = np.minimum(closest, distance(surface, data.xpos[bodies]))
    names = {i: set() for i in bodies}
    for pair in data.contact.geom[: data.ncon]:
        for a, b in (pair, pair[::-1]):
            if model.geom_bodyid[a] in names:
                names[model.geom_bodyid[a]].add(model.geom(b).name)
    side = np.linspace(-1, 1, 9)
    face = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    box = 0.8 * radius * np.concatenate([np.insert(face, k, s, axis=1) for k in range(3) for s in (-1, 1)])
    gaps = []
    for i, b in enumerate(bodies):
        if not any("solid" in n for n in names[b]):
            continue
        if i % 2 == 0:
            gaps.append(distance(surface, data.xpos[b][None])[0] - radius)
        else:
            gaps.append(distance(surface, box @ data.xmat[b].reshape(3, 3).T + data.xpos[b]).min())
    through = int((closest < np.where(np.arange(DROPS) % 2 == 0, 0.5, 0.4) * radius).sum())
    shift = max((abs(float(data.joint(n).qpos[0]) - q) for n, q in twin.state.items()), default=0.0)
    gaps = 1e3 * np.array(gaps) if gaps else np.array([np.nan])
    return dict(rest_mm=[float(np.median(gaps)), float(gaps.max())], on=len(gaps), through=through, moved=shift)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+")
    parser.add_argument("--json")
    parser.add_argument("--no-drops", action="store_true")
    parser.add_argument("--hold", action="store_true", help="joints stay where they are while things drop")
    args = parser.parse_args()
    print(f"{'run':16} {'front 2':>8} {'front 3':>8} {'none':>7} {'p95 mm':>7}  {'rest mm':>12} {'through':>7} "
          f"{'moved':>7}  solids")
    table = {}
    for run in args.runs:
        start = time.time()
        twin = Twin(run)
        poses = twin.poses()
        whole, parts = fronts(twin, poses)
        far = {n: 1e3 * float(np.quantile(to_solids(twin, n), 0.95)) for n in twin.links}
        drop = dict(rest_mm=[0, 0], on=0, through=0, moved=0) if args.no_drops else drops(twin, poses, args.hold)
        counts = {n: len(twin.solids[n]) for n in twin.links}
        table[Path(run).name] = dict(whole=whole, parts=parts, p95_mm=far, solids=counts, **drop)
        rest = f"{drop['rest_mm'][0]:.1f} / {drop['rest_mm'][1]:.1f}"
        print(f"{Path(run).name:16} {whole[0]:8.1%} {whole[1]:8.1%} {whole[2]:7.1%} {max(far.values()):7.1f}  "
              f"{rest:>12} {drop['through']:7} {drop['moved']:7.4f}  {list(counts.values())} "
              f"({time.time() - start:.0f} s)", flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
