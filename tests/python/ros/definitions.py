"""Writes the definitions of src/io/ros2msg/definitions and the hashes of src/node/type_hashes.txt from rosbags, or with --check
compares them.

A file of definitions holds the RIHS01 hash on its first line, then the definition with those of all types it needs (ros2msg).
"""
import sys
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOT = Path(__file__).resolve().parents[3]
FOLDER = ROOT / "src/io/ros2msg/definitions"
DISTROS = [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY, list(Stores)[-1]]
TYPES = [
    "artitwin_msgs/msg/CollectionStatus", "artitwin_msgs/msg/GapReport", "diagnostic_msgs/msg/DiagnosticArray", "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry", "rosgraph_msgs/msg/Clock", "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/Image", "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "sensor_msgs/msg/PointCloud2", "std_msgs/msg/String",
    "tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray",
]
HASHES = ROOT / "src/node/type_hashes.txt"
# Topics of the node that no bag holds.
MORE_TOPICS = ["action_msgs/msg/GoalStatusArray", "rcl_interfaces/msg/Log", "rcl_interfaces/msg/ParameterEvent",
               "rmw_dds_common/msg/ParticipantEntitiesInfo"]
# Services of ROS 2 that the node offers: rosbags knows no services. Request and response, as their .srv files have them.
SERVICES = {
    "action_msgs/srv/CancelGoal": ("action_msgs/GoalInfo goal_info", "int8 return_code\naction_msgs/GoalInfo[] goals_canceling"),
    "rcl_interfaces/srv/DescribeParameters": ("string[] names", "rcl_interfaces/ParameterDescriptor[] descriptors"),
    "rcl_interfaces/srv/GetLoggerLevels": ("string[] names", "rcl_interfaces/LoggerLevel[] levels"),
    "rcl_interfaces/srv/GetParameterTypes": ("string[] names", "uint8[] types"),
    "rcl_interfaces/srv/GetParameters": ("string[] names", "rcl_interfaces/ParameterValue[] values"),
    "rcl_interfaces/srv/ListParameters": ("string[] prefixes\nuint64 depth", "rcl_interfaces/ListParametersResult result"),
    "rcl_interfaces/srv/SetLoggerLevels": ("rcl_interfaces/LoggerLevel[] levels", "rcl_interfaces/SetLoggerLevelsResult[] results"),
    "rcl_interfaces/srv/SetParameters": ("rcl_interfaces/Parameter[] parameters", "rcl_interfaces/SetParametersResult[] results"),
    "rcl_interfaces/srv/SetParametersAtomically": ("rcl_interfaces/Parameter[] parameters", "rcl_interfaces/SetParametersResult result"),
    "std_srvs/srv/Trigger": ("uint8 structure_needs_at_least_one_member", "bool success\nstring message"),
}


def store(distro):
    found = get_typestore(distro)
    for path in sorted((ROOT / "msg/msg").glob("*.msg")):
        found.register(get_types_from_msg(path.read_text(), f"artitwin_msgs/msg/{path.stem}"))
    return found


def parts(path):
    """The parts of a .srv or .action file, without comments."""
    lines = [line.split("#")[0].rstrip() for line in path.read_text().splitlines()]
    return [part.strip() for part in "\n".join(lines).split("---")]


def service_types():
    """Definitions of the messages that services and actions consist of, by their ROS type."""
    found = {}
    services = dict(SERVICES)
    for path in sorted((ROOT / "msg/srv").glob("*.srv")):
        services[f"artitwin_msgs/srv/{path.stem}"] = parts(path)
    for path in sorted((ROOT / "msg/action").glob("*.action")):
        name = f"artitwin_msgs/action/{path.stem}"
        for part, text in zip(("Goal", "Result", "Feedback"), parts(path)):
            found[f"{name}_{part}"] = text
        uuid = "unique_identifier_msgs/UUID goal_id"
        services[f"{name}_SendGoal"] = (f"{uuid}\n{name}_Goal goal", "bool accepted\nbuiltin_interfaces/Time stamp")
        services[f"{name}_GetResult"] = (uuid, f"int8 status\n{name}_Result result")
        found[f"{name}_FeedbackMessage"] = f"{uuid}\n{name}_Feedback feedback"
    for name, (request, response) in services.items():
        found[f"{name}_Request"], found[f"{name}_Response"] = request, response
    return found


def hashes(types):
    """Lines of every type with which the node has endpoints, and its hash."""
    more = service_types()
    for name, text in more.items():
        # rosbags would name it a message.
        (definition,) = get_types_from_msg(text, name).values()
        types.register({name: definition})
    endpoints = [name for name in more if not name.endswith(("_Goal", "_Result", "_Feedback"))]
    return "".join(f"{name} {types.hash_rihs01(name)}\n" for name in sorted([*TYPES, *MORE_TOPICS, *endpoints]))


def main():
    wrong = []
    stores = {distro: store(distro) for distro in DISTROS}
    for name in TYPES:
        path = FOLDER / (name.replace("/msg/", "-") + ".msg")
        texts = {d: s.hash_rihs01(name) + "\n" + s.generate_msgdef(name, ros_version=2)[0] for d, s in stores.items()}
        if "--check" not in sys.argv:
            path.write_text(texts[Stores.ROS2_JAZZY])
        for distro, text in texts.items():
            # Constants differ between distributions; they are no part of the hash, which stands for the bytes.
            same = path.read_text() == text if distro == Stores.ROS2_JAZZY else path.read_text().split("\n")[0] == text.split("\n")[0]
            if not same:
                wrong.append(f"{path.name} differs from {distro.value}")
    found = hashes(store(Stores.ROS2_JAZZY))
    if "--check" not in sys.argv:
        HASHES.write_text(found)
    elif HASHES.read_text() != found:
        wrong.append(f"{HASHES.name} differs")
    print("\n".join(wrong) or f"{len(TYPES)} definitions agree with {', '.join(d.value for d in DISTROS)}")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
