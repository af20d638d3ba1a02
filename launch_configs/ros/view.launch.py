"""RViz with the node, or with a finished twin: `ros2 launch artitwin view.launch.py [urdf:=RUN/twin.ros.urdf]`.

Without `urdf` the node publishes description and frames. With it robot_state_publisher does, and sliders move the joints; no node is
started, so that each frame has one publisher. RViz is looked up first and ends all when it is closed.
"""
import xml.etree.ElementTree
from pathlib import Path

from ament_index_python.packages import get_package_prefix
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

FOLDER = Path(__file__).resolve().parent
# The topic that twin.rviz shows.
DESCRIPTION = ("robot_description", "/artitwin/robot_description")


def root_link(urdf):
    """The link that no joint moves."""
    robot = xml.etree.ElementTree.fromstring(urdf)
    children = {joint.find("child").get("link") for joint in robot.findall("joint")}
    return next(link.get("name") for link in robot.findall("link") if link.get("name") not in children)


def shown(context):
    path = LaunchConfiguration("urdf").perform(context)
    if not path:
        return [IncludeLaunchDescription(PythonLaunchDescriptionSource(str(FOLDER / "node.launch.py")))]
    urdf = Path(path).read_text()
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{"robot_description": ParameterValue(urdf, value_type=str)}],
            remappings=[DESCRIPTION],
        ),
        Node(package="joint_state_publisher_gui", executable="joint_state_publisher_gui", remappings=[DESCRIPTION]),
        Node(
            package="tf2_ros",
            executable="static_transform_publisher",
            arguments=["--frame-id", "world", "--child-frame-id", root_link(urdf)],
        ),
    ]


def generate_launch_description():
    # Where it is missing, this ends the launch before a process was started.
    get_package_prefix("rviz2")
    return LaunchDescription([
        DeclareLaunchArgument("urdf", default_value="", description="URDF of a finished twin"),
        Node(package="rviz2", executable="rviz2", arguments=["-d", str(FOLDER / "twin.rviz")], on_exit=Shutdown()),
        OpaqueFunction(function=shown),
    ])
