#!/usr/bin/env bash
# Installs a build into an empty folder and builds the consumer projects against it: everything, the
# core alone, C alone.
#   run.sh BUILD_FOLDER C++_COMPILER [C_COMPILER]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cmake --install "$1" --prefix "$work/installed" >/dev/null
servosense=$work/installed/bin/servosense
export PKG_CONFIG_PATH
PKG_CONFIG_PATH=$(dirname "$(find "$work/installed" -name servosense.pc)")
build() { # SOURCE NAME [OPTION...]
  local source=$1 name=$2
  shift 2
  cmake -S "$source" -B "$work/$name" -G Ninja -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_PREFIX_PATH="$work/installed" "$@" >/dev/null
  cmake --build "$work/$name"
}
build "$here" build -DCMAKE_CXX_COMPILER="$2"
[ "$("$work/build/host")" = mill ]
[ "$("$work/build/with_pkg_config")" = mill ]

build "$here/core" core -DCMAKE_CXX_COMPILER="$2"
"$work/core/firmware"
pkg-config --exists servosense-core

mkdir "$work/exported"
"$servosense" export --c "$here/c/machine.ini" --out "$work/exported/machine.h" >/dev/null
build "$here/c" c -DCMAKE_C_COMPILER="${3:-cc}" \
  -DCMAKE_C_FLAGS="-std=c99 -Wall -Wextra -Wpedantic -Werror -I$work/exported"
[ "$("$work/c/controller")" = 227 ]
[ "$("$work/c/controller_with_pkg_config")" = 227 ]
[ "$("$work/c/from_file" "$here/c/machine.ini")" = 227 ]
[ "$("$work/c/from_file_with_pkg_config" "$here/c/machine.ini")" = 227 ]
if ldd "$work/c/controller" | grep 'libstdc++'; then
  echo "failed: servosense::c brings the C++ library along"
  exit 1
fi

"$servosense" --version
echo "consumer projects built and run from the install tree"
