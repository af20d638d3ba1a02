#!/usr/bin/env bash
# Finds both packages with colcon in a workspace with a plain clone, builds and installs `artitwin` without ROS, and looks for what
# `ros2 run` and `ros2 launch` look up.
#
# Needs python3 with venv, make, and cargo. Takes a whole build of the crate, unless ARTITWIN_TARGET names a target folder to go on
# from. artitwin_msgs is only listed: rosidl generators are part of ROS, as is ament_cmake, in whose place a stand-in installs nothing
# of its own. What the last run said stands in tests/colcon/last_run.txt.
set -euo pipefail
root="$(cd "$(dirname "$0")/../.." && pwd)"
cache="${XDG_CACHE_HOME:-$HOME/.cache}/artitwin/colcon"
mkdir -p "$cache"
if [ ! -e "$cache/venv-cmake/complete" ]; then
    python3 -m venv "$cache/venv-cmake"
    "$cache/venv-cmake/bin/python" -m pip install --quiet --disable-pip-version-check colcon-core==0.21.3 colcon-ros==0.5.0 colcon-cmake==0.2.30 \
        colcon-recursive-crawl==0.2.3 colcon-package-selection==0.2.10 colcon-package-information==0.4.1 colcon-output==0.2.15 cmake==4.4.5
    touch "$cache/venv-cmake/complete"
fi
export PATH="$cache/venv-cmake/bin:$PATH"

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cd "$work"
mkdir src stub
git clone --quiet "$root" src/artitwin
printf 'macro(ament_package)\nendmacro()\n' > stub/ament_cmakeConfig.cmake
{
    printf '%s, %s\n' "$(date -u +%F)" "$(python3 --version)"
    colcon --log-base log list
    colcon --log-base log build --packages-ignore artitwin_msgs --cmake-args "-Dament_cmake_DIR=$work/stub" \
        ${ARTITWIN_TARGET:+"-DTARGET_FOLDER=$(realpath "$ARTITWIN_TARGET")"} 2>&1 | grep -E '^(Starting|Finished|Failed|Summary)' | sed 's/ \[.*//'
    for file in lib/artitwin/artitwin share/artitwin/launch_configs/ros/{node,view,replay}.launch.py share/artitwin/launch_configs/ros/node.yaml; do
        [ -e "install/artitwin/$file" ] && echo "there: $file" || { echo "MISSING: $file"; missing=yes; }
    done
    install/artitwin/lib/artitwin/artitwin --version
    [ -z "${missing:-}" ]
} | tee "$root/tests/colcon/last_run.txt"
