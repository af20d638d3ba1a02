"""Launch files without ROS: stand-ins for `launch` and `launch_ros` that run a description and note its processes.

They follow the order of launch: actions as listed, an included file with its own arguments, handlers when a process ends. Nothing is
started; every process ends at once with the code that a test gives.
"""
import importlib.util
import sys
import tempfile
import types
from pathlib import Path

from ruamel.yaml import YAML


class Action:
    def __init__(self, *positional, **named):
        self.positional, self.named = positional, named


class LaunchConfiguration:
    def __init__(self, name):
        self.name = name

    def perform(self, context):
        return text(context.arguments[self.name], context)


def text(value, context):
    return value.perform(context) if hasattr(value, "perform") else str(value)


def make(name):
    return type(name, (Action,), {})


NAMES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "EmitEvent", "ExecuteProcess", "IncludeLaunchDescription", "OpaqueFunction",
                       "RegisterEventHandler", "Shutdown"],
    "launch.event_handlers": ["OnProcessExit"],
    "launch.events": ["Shutdown"],
    "launch.launch_description_sources": ["PythonLaunchDescriptionSource"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterValue"],
}


def install(packages):
    """Puts the stand-ins where imports find them; `packages` are those that are installed."""
    for module, names in NAMES.items():
        made = types.ModuleType(module)
        for name in names:
            setattr(made, name, make(name))
        sys.modules[module] = made
    substitutions = types.ModuleType("launch.substitutions")
    substitutions.LaunchConfiguration = LaunchConfiguration
    sys.modules["launch.substitutions"] = substitutions
    index, lookup = types.ModuleType("ament_index_python"), types.ModuleType("ament_index_python.packages")

    def prefix(name):
        if name not in packages:
            raise LookupError(name)
        return "/"

    lookup.get_package_prefix = prefix
    sys.modules |= {"ament_index_python": index, "ament_index_python.packages": lookup}


class Launch:
    """What a launch file starts, given its arguments."""

    def __init__(self, path, codes=None, **arguments):
        self.processes, self.handlers, self.codes = [], [], codes or {}
        self.ended = False
        self.include(path, arguments)

    def include(self, path, arguments):
        spec = importlib.util.spec_from_file_location("described", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        self.arguments = dict(arguments)
        outer = self.arguments
        self.visit(module.generate_launch_description().positional[0])
        self.arguments = outer

    def visit(self, actions):
        for action in actions or []:
            if not self.ended:
                getattr(self, type(action).__name__)(action)

    def DeclareLaunchArgument(self, action):
        name, default = action.positional[0], action.named.get("default_value")
        if name not in self.arguments:
            if default is None:
                raise LookupError(f"{name} is not given")
            self.arguments[name] = default

    def OpaqueFunction(self, action):
        self.visit(action.named["function"](self))

    def IncludeLaunchDescription(self, action):
        given = {k: text(v, self) for k, v in action.named.get("launch_arguments", [])}
        kept = self.arguments
        self.include(action.positional[0].positional[0], given)
        self.arguments = kept

    def RegisterEventHandler(self, action):
        self.handlers.append(action.positional[0].named)

    def EmitEvent(self, action):
        self.ended = True

    def Node(self, action):
        named = action.named
        parameters = {}
        for source in named.get("parameters", []):
            # As launch_ros: later ones win.
            if isinstance(source, dict):
                parameters |= {k: getattr(v, "positional", [v])[0] for k, v in source.items()}
            else:
                parameters |= YAML(typ="safe").load(Path(text(source, self)))["/**"]["ros__parameters"]
        self.processes.append((named["executable"], parameters, named))

    def ExecuteProcess(self, action):
        command = [text(c, self) for c in action.named["cmd"]]
        self.processes.append((" ".join(command), {}, action.named))
        event = types.SimpleNamespace(returncode=self.codes.get(" ".join(command[1:3]), 0), cmd=command)
        for handler in self.handlers:
            if handler["target_action"] is action:
                self.visit(handler["on_exit"](event, self))

    def names(self):
        return [name for name, _, _ in self.processes]


def check(root):
    """What the launch files must do."""
    install({"rviz2"})
    folder = root / "launch_configs/ros"
    with tempfile.TemporaryDirectory() as made:
        own = Path(made, "own.yaml")
        own.write_text("/**:\n  ros__parameters:\n    parts: 2\n")
        # A file of parameters counts, and what is given on the command line wins over it.
        [(_, parameters, _)] = Launch(folder / "node.launch.py", params=str(own)).processes
        assert parameters["parts"] == 2, parameters
        [(_, parameters, _)] = Launch(folder / "node.launch.py", params=str(own), parts="3").processes
        assert parameters["parts"] == 3, parameters
        urdf = Path(made, "own.urdf")
        urdf.write_text('<robot name="a"><link name="base"/><link name="part"/><joint><parent link="base"/><child link="part"/></joint></robot>')
        view = Launch(folder / "view.launch.py", urdf=str(urdf))
    # One publisher of /tf, on the topic that RViz shows.
    assert Launch(folder / "view.launch.py").names() == ["rviz2", "artitwin"]
    assert view.names() == ["rviz2", "robot_state_publisher", "joint_state_publisher_gui", "static_transform_publisher"], view.names()
    layout = (folder / "twin.rviz").read_text()
    for _, _, named in view.processes[1:3]:
        assert f"Value: {dict(named['remappings'])['robot_description']}\n" in layout
    assert view.processes[3][2]["arguments"][-1] == "base" and "Fixed Frame: world" in layout
    # Nothing is left behind where RViz is missing.
    install(set())
    try:
        Launch(folder / "view.launch.py")
        raise AssertionError("RViz is missing, and the launch goes on")
    except LookupError:
        pass
    # States begin and end, a twin is asked for, and a step that fails ends all.
    replay = Launch(folder / "replay.launch.py", bag="bags/drawer")
    assert replay.processes[0][1]["parts"] == 2 and replay.processes[0][1]["use_sim_time"] is True
    steps = [name.split(" artitwin_msgs")[0] for name in replay.names()[1:]]
    assert [s.split()[-1] for s in steps] == [
        "/artitwin/start_state", "bags/drawer/state0", "/artitwin/finish_state",
        "/artitwin/start_state", "bags/drawer/state1", "/artitwin/finish_state", "/artitwin/reconstruct"], steps
    failed = Launch(folder / "replay.launch.py", codes={"bag play": 1}, bag="bags/drawer")
    assert failed.ended and len(failed.processes) == 3, failed.names()
