"""Writes the definitions of src/io/ros2msg/definitions from rosbags, or with --check compares them.

A file holds the RIHS01 hash on its first line, then the definition with those of all types it needs (ros2msg).
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


def store(distro):
    found = get_typestore(distro)
    for path in sorted((ROOT / "msg/msg").glob("*.msg")):
        found.register(get_types_from_msg(path.read_text(), f"artitwin_msgs/msg/{path.stem}"))
    return found


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
    print("\n".join(wrong) or f"{len(TYPES)} definitions agree with {', '.join(d.value for d in DISTROS)}")
    sys.exit(bool(wrong))


main()
