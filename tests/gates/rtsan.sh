#!/bin/sh
# RealtimeSanitizer gate: the compiler must find nothing that may block in any process()
# (-Wfunction-effects), the run must find nothing either, and both must find a planted violation.
#   rtsan.sh [BUILD_DIR]
# CXX_REALTIME names the compiler (clang 20 or newer). Status 77: there is none.
set -u
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
build=${1:-$(mktemp -d)}
mkdir -p "$build"

works() {
  command -v "$1" >/dev/null 2>&1 &&
    echo 'int main() { return 0; }' >"$build/probe.cpp" &&
    "$1" -fsanitize=realtime "$build/probe.cpp" -o "$build/probe" >"$build/probe.log" 2>&1 &&
    "$build/probe"
}
compiler=
for candidate in ${CXX_REALTIME:-clang++ clang++-20 clang++-21 clang++-22 clang++-23 clang++-24}; do
  if works "$candidate"; then
    compiler=$candidate
    break
  fi
done
if [ -z "$compiler" ]; then
  echo "SKIPPED: no compiler with RealtimeSanitizer (clang 20 or newer and its runtime;" \
    "CXX_REALTIME names one)"
  exit 77
fi
echo "RealtimeSanitizer of $("$compiler" --version | head -n 1)"

compile() {
  "$compiler" -std=c++20 -O1 -g -fsanitize=realtime -Wall -Wextra -Wfunction-effects -Werror \
    -I"$root/include" "$@" "$here/realtime_blocks.cpp" -o "$build/realtime_blocks"
}
if compile -DPLANT_AT_COMPILE_TIME >"$build/plant.log" 2>&1 ||
  ! grep -q 'Wfunction-effects' "$build/plant.log"; then
  cat "$build/plant.log"
  echo "-Wfunction-effects let the planted violation pass"
  exit 1
fi
compile || { echo "a block may block (see the warnings above)"; exit 1; }

"$build/realtime_blocks" --plant >"$build/plant.log" 2>&1
status=$?
if [ $status -ne 43 ]; then
  cat "$build/plant.log"
  echo "the planted violation ended with status $status, not 43"
  exit 1
fi
"$build/realtime_blocks" || { echo "a block broke its promise, status $?"; exit 1; }
echo "no block may or did block; both planted violations were found"
