"""A pendulum-like joint in URDF and its recorded motion."""
import math
import struct

from mcap_file import text


def link(name, more="", mass="1"):
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/>'
        f'<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>'
    )


def joint(name, parent, child, more="", kind="revolute"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>'
        f'<limit lower="-1" upper="1" effort="1" velocity="1"/>{more}</joint>'
    )


def robot(*elements):
    return f'<robot name="r">{"".join(elements)}</robot>'


TWIN = robot(link("a"), link("b"), joint("j", "a", "b"))
DEFINITION = b"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"


def padded(out, size):
    return out + bytes(-(len(out)) % size)


def joint_state(nanos, names, columns):
    """A serialized sensor_msgs/JointState."""
    out = struct.pack("<iI", nanos // 10**9, nanos % 10**9) + text("\0")
    out = padded(out, 4) + struct.pack("<I", len(names))
    for name in names:
        out = padded(out, 4) + text(name + "\0")
    for column in columns:
        out = padded(out, 4) + struct.pack("<I", len(column))
        if column:
            out = padded(out, 8) + struct.pack(f"<{len(column)}d", *column)
    return b"\0\1\0\0" + out


def log(names=("j",), count=600):
    """A joint swung at 3 rad/s with an inertia of 1 kg m^2 and viscous friction of 0.13."""
    found = []
    for i in range(count):
        nanos, t = i * 10_000_000 + 10**18, i * 0.01
        columns = [[0.5 * math.sin(3 * t)], [1.5 * math.cos(3 * t)], [-4.5 * math.sin(3 * t) + 0.2 * math.cos(3 * t)]]
        data = joint_state(nanos, names, [c * len(names) for c in columns])
        found.append(("/joint_states", "sensor_msgs/msg/JointState", DEFINITION, nanos, data))
    return found
