"""Package, interface and launch files, checked without ROS."""
import ast
import re
import sys
from pathlib import Path

import launching
from catkin_pkg.package import parse_package
from rosbags.typesys import get_types_from_msg

root = Path(sys.argv[1])
names = []
for path in (root / "launch_configs/ros/package.xml", root / "msg/package.xml"):
    package = parse_package(str(path))
    package.validate()
    names.append(package.name)
# colcon does not look below a package: neither may lie in the other's folder, or below the top of the repository.
assert not (root / "package.xml").exists()
# Every package that a launch file starts is a dependency.
depends = {d.name for d in parse_package(str(root / "launch_configs/ros/package.xml")).exec_depends}
cmake = (root / "msg/CMakeLists.txt").read_text()
interfaces = 0
for path in sorted((root / "msg").glob("*/*.*")):
    parts = path.read_text().split("---")
    assert len(parts) == {".msg": 1, ".srv": 2, ".action": 3}[path.suffix], path
    for i, part in enumerate(parts):
        text = "\n".join(line for line in part.splitlines() if line.split("#")[0].strip())
        assert get_types_from_msg(text, f"artitwin_msgs/msg/{path.stem}{i}"), path
    assert f'"{path.parent.name}/{path.name}"' in cmake, f"CMakeLists.txt does not name {path}"
    interfaces += 1
launch = sorted((root / "launch_configs/ros").glob("*.launch.py"))
for path in launch:
    functions = [n.name for n in ast.parse(path.read_text()).body if isinstance(n, ast.FunctionDef)]
    assert "generate_launch_description" in functions, path
    started = set(re.findall(r'package="(\w+)"', path.read_text())) - {"artitwin"}
    assert started <= depends, started - depends
launching.check(root)
print(*names, interfaces, "interfaces", len(launch), "launch files")
