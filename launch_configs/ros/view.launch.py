"""The node with robot_state_publisher and RViz: `ros2 launch artitwin view.launch.py urdf:=RUN/twin.ros.urdf`.

robot_state_publisher takes a URDF when it starts, so it shows a finished twin; the node then leaves /tf to it. Without
`urdf` the node publishes the frames itself and RViz takes the description from its topic.
"""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import Command, LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

FOLDER = Path(__file__).resolve().parent


def generate_launch_description():
    urdf = LaunchConfiguration("urdf")
    given = IfCondition(PythonExpression(["'", urdf, "' != ''"]))
    return LaunchDescription([
        DeclareLaunchArgument("urdf", default_value="", description="URDF of a finished twin"),
        IncludeLaunchDescription(PythonLaunchDescriptionSource(str(FOLDER / "node.launch.py"))),
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{"robot_description": ParameterValue(Command(["cat ", urdf]), value_type=str)}],
            condition=given,
        ),
        Node(package="rviz2", executable="rviz2", arguments=["-d", str(FOLDER / "twin.rviz")]),
    ])
