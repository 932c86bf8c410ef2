#!/usr/bin/env bash
# Sets up, builds, and runs the main job on two traces: a recorded production part (bundled) and a
# synthetic cut that ends in chatter and a collision. Leaves an HTML report of each in out/.
set -euo pipefail
cd "$(dirname "$0")/.."
cmake/install_packages.sh g++ cmake ninja-build libeigen3-dev libmodbus-dev
cmake --preset release -DSERVOSENSE_TESTS=OFF -DSERVOSENSE_BENCH=OFF >/dev/null
cmake --build --preset release --target servosense_cli synthetic_cut
program=build/release/servosense
mkdir -p out

echo
echo "== A production part, recorded at 1 kHz (currents without a published scale: ratios) =="
$program monitor --machine examples/machines/turnmill.ini --trace tests/data/turnmill/part_excerpt.csv \
  --events out/turnmill.jsonl --report out/turnmill.html

echo
echo "== A synthetic cut at 8 kHz: learn the machine in the air, then watch it cut =="
build/release/examples/synthetic_cut --idle out/idle.csv
build/release/examples/synthetic_cut --cut out/cut.csv
$program identify idle --machine examples/machines/koike_tc_s2c.ini --trace out/idle.csv --out out/machine.ini
$program monitor --machine out/machine.ini --trace out/cut.csv --events out/cut.jsonl --report out/cut.html

echo
echo "open out/turnmill.html and out/cut.html in a browser"
