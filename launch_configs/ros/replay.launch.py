"""A twin of two recordings, through the node: `ros2 launch artitwin replay.launch.py bag:=bags/drawer`.

Each state is begun, its recording is played, and it is ended; then the twin is asked for. A step that fails ends the launch. Needs
artitwin_msgs (`msg/`) built and sourced.
"""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument, EmitEvent, ExecuteProcess, IncludeLaunchDescription, OpaqueFunction, RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

FOLDER = Path(__file__).resolve().parent


def call(service, state):
    return ["ros2", "service", "call", f"/artitwin/{service}", "artitwin_msgs/srv/SetState", f"{{state: {state}}}"]


def steps(context):
    """The commands, one after the other."""
    bag = Path(LaunchConfiguration("bag").perform(context))
    rate, parts = (LaunchConfiguration(name).perform(context) for name in ("rate", "parts"))
    commands = []
    for state in (0, 1):
        play = ["ros2", "bag", "play", "--clock", "100", "--rate", rate, str(bag / f"state{state}")]
        commands += [call("start_state", state), play, call("finish_state", state)]
    goal = ["ros2", "action", "send_goal", "--feedback", "/artitwin/reconstruct", "artitwin_msgs/action/Reconstruct"]
    return commands + [[*goal, f"{{parts: {parts}}}"]]


def chain(context):
    processes = [ExecuteProcess(cmd=command, output="screen") for command in steps(context)]
    handlers = []
    for process, following in zip(processes, [*processes[1:], None]):

        def ended(event, _, following=following):
            if event.returncode == 0:
                # After the last step the node stays, with the twin on its topics.
                return [following] if following else []
            return [EmitEvent(event=Shutdown(reason=f"{' '.join(event.cmd)} failed"))]

        handlers.append(RegisterEventHandler(OnProcessExit(target_action=process, on_exit=ended)))
    return [*handlers, processes[0]]


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("bag", description="folder with the recordings state0 and state1"),
        DeclareLaunchArgument("rate", default_value="1.0", description="speed"),
        DeclareLaunchArgument("parts", default_value="2", description="rigid parts, the static one included"),
        DeclareLaunchArgument("params", default_value=str(FOLDER / "replay.yaml"), description="parameter file"),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(FOLDER / "node.launch.py")),
            launch_arguments={"params": LaunchConfiguration("params"), "parts": LaunchConfiguration("parts")}.items(),
        ),
        OpaqueFunction(function=chain),
    ])
