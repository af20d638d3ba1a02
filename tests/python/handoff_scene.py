"""Loads the scenes of a model folder in MuJoCo and expands its xacro; prints JSON of what is there.

    python handoff_scene.py DIR NAME

`joints`, `free_joints`, `actuators`: of `scene_actuated.xml`. `held`, `reached`: by joint, how far an actuator stays off its goal, as a share of the
observed interval, after it held the last state, and after it was sent back to the first one. `expanded_links`, `controlled_joints`: of the xacro
with the prefix `own_`, held by a link `stand`, with ros2_control; `without_prefix`: names of it that lack the prefix. `missing`: files that a file
of the package names and that are not there.
"""

import json
import re
import sys
import types
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

SECONDS = 5.0


def scenes(folder, name):
    import mujoco

    twin, scene = (mujoco.MjModel.from_xml_path(str(folder / f)) for f in (f"{name}.xml", "scene.xml"))
    assert (twin.nu, scene.nu, twin.nq) == (0, 0, scene.nq), "the twin's own file is passive"
    assert scene.ncam == 1 and scene.nlight == 1 and scene.ngeom == twin.ngeom + 1
    assert [scene.joint(j).name for j in range(scene.njnt)] == [twin.joint(j).name for j in range(twin.njnt)]
    model = mujoco.MjModel.from_xml_path(str(folder / "scene_actuated.xml"))
    free = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    found = {"joints": model.njnt - len(free), "free_joints": len(free), "actuators": model.nu, "held": {}, "reached": {}}
    keys = [k for k in range(model.nkey) if "hold" in model.key(k).name]
    first, last = keys[0], keys[-1]
    data = mujoco.MjData(model)

    def run(goals):
        data.ctrl[:] = goals
        for _ in range(round(SECONDS / model.opt.timestep)):
            mujoco.mj_step(model, data)
        assert np.isfinite(data.qpos).all() and data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number == 0

    def off(goals):
        errors = {}
        for a in range(model.nu):
            joint = model.actuator_trnid[a][0]
            span = abs(model.key_ctrl[last][a] - model.key_ctrl[first][a])
            errors[model.joint(joint).name] = float(abs(data.qpos[model.jnt_qposadr[joint]] - goals[a]) / span)
        return errors

    mujoco.mj_resetDataKeyframe(model, data, last)
    run(model.key_ctrl[last])
    found["held"] = off(model.key_ctrl[last])
    run(model.key_ctrl[first])
    found["reached"] = off(model.key_ctrl[first])
    # Nothing falls through the floor, or is thrown from it.
    assert not free or abs(data.qpos[2]) < 0.01, data.qpos
    return found


def expanded(folder, name):
    import xacro

    path = folder / f"{name}.urdf.xacro"
    bare = xacro.process_file(str(path)).toxml()
    wanted = ElementTree.parse(folder / f"{name}.ros.urdf").getroot()
    same = ElementTree.fromstring(bare)
    # Places to grasp are frames of the macro alone.
    for tag in ("link", "joint"):
        names = [x.get("name") for x in same.findall(tag)]
        assert [n for n in names if "_grasp_" not in n] == [x.get("name") for x in wanted.findall(tag)], tag
    settings = {"prefix": "own_", "parent": "stand", "ros2_control": "true"}
    robot = ElementTree.fromstring(xacro.process_file(str(path), mappings=settings).toxml())
    tags = ("link", "joint", "visual", "collision", "mimic", "parent", "child", "gazebo", "ros2_control")
    named = [(x.tag, x.get("name") or x.get("link") or x.get("joint") or x.get("reference")) for x in robot.iter() if x.tag in tags]
    plain = sorted({n for _, n in named if not n.startswith("own_") and n != "stand"})
    links = {x.get("name") for x in robot.findall("link")}
    ends = [x.get("link") for j in robot.findall("joint") for x in (j.find("parent"), j.find("child"))]
    assert set(ends) <= links and sum(x not in ends[1::2] for x in links) == 1, "one tree"
    control = robot.find("ros2_control")
    commanded = [j.get("name") for j in control.findall("joint") if j.find("command_interface") is not None]
    moving = {j.get("name") for j in robot.findall("joint") if j.get("type") != "fixed"}
    assert {j.get("name") for j in control.findall("joint")} == moving
    group = [j.get("name") for j in ElementTree.parse(folder / f"config/{name}.srdf").getroot().find("group").findall("joint")]
    assert [f"own_{j}" for j in group] == commanded
    return {"expanded_links": sum("_grasp_" not in n for n in links), "controlled_joints": len(moving), "without_prefix": plain}


def named_files(folder, name):
    """Paths in the folder that its files name, and that are not there."""
    found = set()
    for path in [*folder.glob("*.urdf"), *folder.glob("*.xacro"), *folder.glob("*.sdf"), *folder.glob("single_joint/*.urdf")]:
        for text in re.findall(r'filename="([^"$]+)"|<uri>([^<]+)</uri>', path.read_text()):
            file = "".join(text)
            inside = folder / file.removeprefix(f"package://{name}/") if "://" in file else path.parent / file
            found |= set() if inside.is_file() else {file}
    install = re.findall(r"install\((DIRECTORY|FILES)\n(.*?)  DESTINATION", (folder / "CMakeLists.txt").read_text(), re.S)
    for kind, names in install:
        for file in names.split():
            is_there = (folder / file).is_dir() if kind == "DIRECTORY" else (folder / file).is_file()
            found |= set() if is_there else {file}
    return sorted(found | launched(folder, name))


def launched(folder, name):
    """Runs the launch file with stand-ins for ROS; files that it opens or names and that are not there."""
    nodes = []
    stand_ins = {
        "ament_index_python.packages": {"get_package_share_directory": lambda package: {name: str(folder)}[package]},
        "launch": {"LaunchDescription": list},
        "launch_ros.actions": {"Node": lambda **arguments: nodes.append(arguments)},
    }
    for module, members in stand_ins.items():
        sys.modules[module.split(".")[0]] = sys.modules.get(module.split(".")[0], types.ModuleType(module))
        sys.modules[module] = types.ModuleType(module)
        vars(sys.modules[module]).update(members)
    scope = {}
    exec(compile((folder / "launch/display.launch.py").read_text(), "display.launch.py", "exec"), scope)
    scope["generate_launch_description"]()
    assert [n["package"] for n in nodes] == ["robot_state_publisher", "joint_state_publisher_gui", "rviz2"]
    description = nodes[0]["parameters"][0]["robot_description"]
    assert ElementTree.fromstring(description).get("name") == name
    return {a for n in nodes for a in n.get("arguments", []) if a.startswith("/") and not Path(a).is_file()}


def main():
    folder, name = Path(sys.argv[1]).resolve(), sys.argv[2]
    print(json.dumps(scenes(folder, name) | expanded(folder, name) | {"missing": named_files(folder, name)}))


if __name__ == "__main__":
    main()
