"""The node and a recording that is played to it: `ros2 launch artitwin replay.launch.py bag:=bags/drawer/state0`."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

FOLDER = Path(__file__).resolve().parent


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("bag", description="folder of a rosbag2 recording"),
        DeclareLaunchArgument("rate", default_value="1.0", description="speed"),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(str(FOLDER / "node.launch.py")),
            launch_arguments={"params": str(FOLDER / "replay.yaml"), "parts": "2"}.items(),
        ),
        ExecuteProcess(
            cmd=["ros2", "bag", "play", "--clock", "100", "--rate", LaunchConfiguration("rate"), LaunchConfiguration("bag")],
            output="screen",
        ),
    ])
