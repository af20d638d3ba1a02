"""Package, interface and launch files, checked without ROS."""
import ast
import sys
from pathlib import Path

from catkin_pkg.package import parse_package
from rosbags.typesys import get_types_from_msg

root = Path(sys.argv[1])
names = []
for path in (root / "package.xml", root / "msg/package.xml"):
    package = parse_package(str(path))
    package.validate()
    names.append(package.name)
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
print(*names, interfaces, "interfaces", len(launch), "launch files")
