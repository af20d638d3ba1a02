"""The node alone: `ros2 launch artitwin node.launch.py parts:=2`."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

FOLDER = Path(__file__).resolve().parent


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("params", default_value=str(FOLDER / "node.yaml"), description="parameter file"),
        DeclareLaunchArgument("parts", default_value="0", description="rigid parts, the static one included"),
        DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
        Node(
            package="artitwin",
            executable="artitwin",
            arguments=["node"],
            name="artitwin",
            namespace=LaunchConfiguration("namespace"),
            parameters=[
                LaunchConfiguration("params"),
                {"parts": ParameterValue(LaunchConfiguration("parts"), value_type=int)},
            ],
            output="screen",
        ),
    ])
