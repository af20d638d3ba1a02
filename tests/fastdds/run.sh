#!/usr/bin/env bash
# The tests of the node with Fast DDS in place of Cyclone DDS: tests/fastdds/run.sh [FILTER]
#
# Uses the Fast DDS that is installed (Debian: libfastrtps-dev, libfastcdr-dev); else, on Debian, unpacks its packages into
# a folder of the cache, without installing them. Needs g++, and for Python what the node's tests need. What the last run
# said stands in tests/fastdds/last_run.txt.
set -euo pipefail
cd "$(dirname "$0")/../.."
cache="${XDG_CACHE_HOME:-$HOME/.cache}/artitwin/fastdds"
packages=(libfastrtps2.9 libfastrtps-dev libfastcdr1 libfastcdr-dev libfoonathan-memory0.7.2 libfoonathan-memory-dev libtinyxml2-9)
multiarch="$(g++ -print-multiarch)"
mkdir -p "$cache"

root=
if ! echo '#include <fastdds/dds/domain/DomainParticipant.hpp>' | g++ -std=c++17 -fsyntax-only -x c++ - 2>/dev/null; then
    root="$cache/root"
    if [ ! -e "$root/complete" ]; then
        (cd "$cache" && apt-get download "${packages[@]}")
        for package in "$cache"/*.deb; do
            dpkg -x "$package" "$root"
        done
        touch "$root/complete"
    fi
fi
g++ -std=c++17 -O1 -shared -fPIC ${root:+-I"$root/usr/include" -I"$root/usr/include/$multiarch" -L"$root/usr/lib/$multiarch"} \
    -Wl,--disable-new-dtags ${root:+-Wl,-rpath,"$root/usr/lib/$multiarch"} -Wl,--no-as-needed -Wl,--allow-shlib-undefined \
    -o "$cache/libpeer.so" tests/fastdds/peer.cpp -lfastrtps -lfastcdr

export DDS_PEER=fastdds FASTDDS_PEER="$cache/libpeer.so"
{
    printf '%s, Fast DDS %s, %s\n' "$(date -u +%F)" "$(basename "$(readlink -f "${root:-}/usr/lib/$multiarch/libfastrtps.so")")" "$(uname -sm)"
    cargo test --release --test node -- "$@" 2>&1 | grep -E '^test |^test result|panicked|FAILED' | sed "s#$HOME#~#g"
} | tee tests/fastdds/last_run.txt
