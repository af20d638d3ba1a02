#!/usr/bin/env bash
# Builds and installs the package with colcon, without ROS, and looks for what `ros2 run` and `ros2 launch` look up.
#
# Needs python3 with venv, and cargo. Takes a whole build of the crate, unless ARTITWIN_TARGET names a target folder to go on
# from. artitwin_msgs is only listed: rosidl generators are part of ROS. What the last run said stands in
# tests/colcon/last_run.txt.
set -euo pipefail
root="$(cd "$(dirname "$0")/../.." && pwd)"
cache="${XDG_CACHE_HOME:-$HOME/.cache}/artitwin/colcon"
mkdir -p "$cache"
if [ ! -e "$cache/venv/complete" ]; then
    python3 -m venv "$cache/venv"
    "$cache/venv/bin/python" -m pip install --quiet --disable-pip-version-check colcon-core==0.21.3 colcon-ros==0.5.0 \
        colcon-cargo==0.2.0 colcon-ros-cargo==0.2.0 colcon-package-selection==0.2.10 colcon-package-information==0.4.1 colcon-output==0.2.15
    touch "$cache/venv/complete"
fi
export PATH="$cache/venv/bin:$cache/bin:$PATH"
command -v cargo-ament-build >/dev/null || cargo install --quiet --locked --root "$cache" --version 0.1.11 cargo-ament-build

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cd "$work"
mkdir build
[ -z "${ARTITWIN_TARGET:-}" ] || ln -s "$(realpath "$ARTITWIN_TARGET")" build/artitwin
paths=(--base-paths "$root" "$root/msg")
{
    printf '%s, %s\n' "$(date -u +%F)" "$(python3 --version)"
    colcon --log-base log list "${paths[@]}" | sed "s#$root#.#"
    colcon --log-base log build "${paths[@]}" --packages-select artitwin --build-base build --install-base install \
        --cargo-args --profile release 2>&1 | grep -E '^(Starting|Finished|Failed|Summary)' | sed 's/ \[.*//'
    for file in lib/artitwin/artitwin share/ament_index/resource_index/packages/artitwin share/artitwin/package.xml \
        share/artitwin/launch_configs/ros/{node,view,replay}.launch.py share/artitwin/launch_configs/ros/node.yaml; do
        [ -e "install/artitwin/$file" ] && echo "there: $file" || { echo "MISSING: $file"; missing=yes; }
    done
    install/artitwin/lib/artitwin/artitwin --version
    [ -z "${missing:-}" ]
} | tee "$root/tests/colcon/last_run.txt"
