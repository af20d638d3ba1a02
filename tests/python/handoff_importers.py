"""Loads a model folder in every importer that is installed and prints what each one sees.

    python handoff_importers.py DIR NAME

The last line is JSON: {importer: {"links", "joints", "solids", "visuals", "textures", "mass", "limits": {joint: [lower, upper]}}}; a number that
an importer does not report is left out. Exit codes prove nothing: the caller compares the counts.
"""

import json
import logging
import sys
from math import pi
from pathlib import Path


def mujoco(path, textures):
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    joints = {model.joint(j).name: [float(x) for x in model.jnt_range[j]] for j in range(model.njnt)}
    shown = {
        "links": model.nbody - 1,
        "joints": model.njnt,
        "solids": int((model.geom_contype > 0).sum()),
        "visuals": int((model.geom_contype == 0).sum()),
        "mass": float(model.body_mass.sum()),
        "limits": joints,
    }
    return shown | ({"textures": model.ntex, "states": model.nkey, "excludes": model.nexclude} if textures else {})


def pybullet(path):
    import pybullet as p

    p.connect(p.DIRECT)
    flags = p.URDF_USE_INERTIA_FROM_FILE | p.URDF_USE_MATERIAL_COLORS_FROM_MTL
    body = p.loadURDF(str(path), useFixedBase=False, flags=flags)
    info = [p.getJointInfo(body, j) for j in range(p.getNumJoints(body))]
    visuals = p.getVisualShapeData(body, p.VISUAL_SHAPE_DATA_TEXTURE_UNIQUE_IDS)
    links = range(-1, len(info))
    shown = {
        "links": len(info) + 1,
        "joints": len(info),
        "solids": sum(len(p.getCollisionShapeData(body, link)) for link in links),
        "visuals": len(visuals),
        "textures": sum(v[8] >= 0 for v in visuals),
        "mass": sum(p.getDynamicsInfo(body, link)[0] for link in links),
        "limits": {i[1].decode(): [i[8], i[9]] for i in info},
    }
    p.disconnect()
    return shown


def drake(path):
    from pydrake.all import AddMultibodyPlantSceneGraph, DiagramBuilder, Parser

    logging.getLogger("drake").setLevel(logging.ERROR)
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    [model] = Parser(plant).AddModels(str(path))
    plant.Finalize()
    bodies = [plant.get_body(b) for b in plant.GetBodyIndices(model)]
    joints = [plant.get_joint(j) for j in plant.GetJointIndices(model)]
    moving = [j for j in joints if j.num_positions() == 1]
    return {
        "links": len(bodies),
        "joints": len(moving),
        "solids": sum(len(plant.GetCollisionGeometriesForBody(b)) for b in bodies),
        "visuals": sum(len(plant.GetVisualGeometriesForBody(b)) for b in bodies),
        "mass": plant.CalcTotalMass(plant.CreateDefaultContext(), [model]),
        "limits": {j.name(): [float(j.position_lower_limits()[0]), float(j.position_upper_limits()[0])] for j in moving},
    }


def yourdfpy(path):
    from yourdfpy import URDF

    robot = URDF.load(str(path), build_collision_scene_graph=True, load_collision_meshes=True)
    textured = [g for g in robot.scene.geometry.values() if getattr(getattr(g.visual, "material", None), "image", None) is not None]
    return {
        "links": len(robot.link_map),
        "joints": len(robot.joint_map),
        "solids": sum(len(link.collisions) for link in robot.link_map.values()),
        "visuals": len(robot.scene.geometry),
        "textures": len(textured),
        "mass": sum(link.inertial.mass for link in robot.link_map.values()),
        "limits": {name: [j.limit.lower, j.limit.upper] for name, j in robot.joint_map.items()},
    }


def usd(path):
    from pxr import Usd, UsdPhysics, UsdShade

    stage = Usd.Stage.Open(str(path))
    prims = list(stage.Traverse())
    revolute = [UsdPhysics.RevoluteJoint(p) for p in prims if p.IsA(UsdPhysics.RevoluteJoint)]
    prismatic = [UsdPhysics.PrismaticJoint(p) for p in prims if p.IsA(UsdPhysics.PrismaticJoint)]
    limits = {j.GetPrim().GetName(): [x.Get() * scale for x in (j.GetLowerLimitAttr(), j.GetUpperLimitAttr())] for scale, all_ in ((pi / 180, revolute), (1, prismatic)) for j in all_}
    textures = [p for p in prims if p.IsA(UsdShade.Shader) and UsdShade.Shader(p).GetIdAttr().Get() == "UsdUVTexture"]
    files = [UsdShade.Shader(p).GetInput("file").Get().resolvedPath for p in textures]
    solids = [p for p in prims if p.HasAPI(UsdPhysics.CollisionAPI)]
    return {
        "links": sum(p.HasAPI(UsdPhysics.RigidBodyAPI) for p in prims),
        "joints": len(revolute) + len(prismatic),
        "solids": len(solids),
        "visuals": sum(p.GetTypeName() == "Mesh" for p in prims) - len(solids),
        "textures": sum(Path(f).is_file() for f in files if f),
        "mass": sum(UsdPhysics.MassAPI(p).GetMassAttr().Get() for p in prims if p.HasAPI(UsdPhysics.MassAPI)),
        "limits": limits,
    }


def main():
    folder, name = Path(sys.argv[1]).resolve(), sys.argv[2]
    urdf = folder / f"{name}.urdf"
    found = {
        "mujoco mjcf": mujoco(folder / f"{name}.xml", True),
        "mujoco urdf": mujoco(urdf, False),
        "pybullet": pybullet(urdf),
        "drake urdf": drake(urdf),
        "drake mjcf": drake(folder / f"{name}.xml"),
        "drake sdf": drake(folder / "model.sdf"),
        "yourdfpy": yourdfpy(urdf),
        "usd": usd(folder / f"{name}.usda"),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
