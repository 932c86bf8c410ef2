#!/usr/bin/env bash
# Installs a build into an empty folder and builds the consumer project against it:
#   run.sh BUILD_FOLDER C++_COMPILER
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$1" --prefix "$work/installed" >/dev/null
PKG_CONFIG_PATH=$(dirname "$(find "$work/installed" -name servosense.pc)") \
  cmake -S "$here" -B "$work/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER="$2" \
  -DCMAKE_PREFIX_PATH="$work/installed" >/dev/null
cmake --build "$work/build"
"$work/build/firmware"
[ "$("$work/build/host")" = mill ]
[ "$("$work/build/with_pkg_config")" = mill ]
"$work/installed/bin/servosense" --version
echo "consumer project built and run from the install tree"
