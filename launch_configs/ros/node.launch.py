"""The node alone: `ros2 launch artitwin node.launch.py parts:=2 params:=FILE`. What is not given here stands in the file."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

FOLDER = Path(__file__).resolve().parent


def node(context):
    parameters = [LaunchConfiguration("params")]
    parts = LaunchConfiguration("parts").perform(context)
    # Given last it would win over the file, so it is given only where somebody did.
    if parts:
        parameters.append({"parts": int(parts)})
    return [
        Node(
            package="artitwin",
            executable="artitwin",
            arguments=["node"],
            name="artitwin",
            namespace=LaunchConfiguration("namespace"),
            parameters=parameters,
            output="screen",
        )
    ]


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("params", default_value=str(FOLDER / "node.yaml"), description="parameter file"),
        DeclareLaunchArgument("parts", default_value="", description="rigid parts, the static one included"),
        DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
        OpaqueFunction(function=node),
    ])
