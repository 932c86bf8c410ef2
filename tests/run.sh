#!/usr/bin/env bash
# Builds everything and runs all tests.
set -euo pipefail
cd "$(dirname "$0")/.."
cmake/install_packages.sh g++ cmake ninja-build libeigen3-dev libmodbus-dev pkg-config
cmake --preset release -DSERVOSENSE_TESTS=ON -DSERVOSENSE_EXAMPLES=ON -DSERVOSENSE_BENCH=ON >/dev/null
cmake --build --preset release
ctest --preset release -j "$(nproc)" "$@"
