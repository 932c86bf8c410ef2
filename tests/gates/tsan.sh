#!/bin/sh
# ThreadSanitizer gate: what runs beside the samples (MTConnect server, stop request, Modbus) has no
# race, and a planted one is found. Only the adapters and what they need are built.
#   tsan.sh [BUILD_DIR]
# CXX_THREAD names the compiler (clang or g++). Status 77: none has the sanitizer.
set -u
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
build=${1:-$(mktemp -d)}
mkdir -p "$build"
tests="shdr_server stop_request modbus_rows"

cat >"$build/race.cpp" <<'RACE'
#include <thread>
int shared;
int main() {
  std::thread other([] { ++shared; });
  ++shared;
  other.join();
}
RACE
compiler=
for candidate in ${CXX_THREAD:-clang++ g++}; do
  if command -v "$candidate" >/dev/null 2>&1 &&
    "$candidate" -std=c++20 -O1 -fsanitize=thread "$build/race.cpp" -o "$build/race" \
      >"$build/probe.log" 2>&1; then
    compiler=$candidate
    break
  fi
done
if [ -z "$compiler" ]; then
  echo "SKIPPED: no compiler with ThreadSanitizer (CXX_THREAD names one)"
  exit 77
fi
echo "ThreadSanitizer of $("$compiler" --version | head -n 1)"
export TSAN_OPTIONS=halt_on_error=1:exitcode=66
"$build/race" >"$build/race.log" 2>&1
status=$?
if [ "$status" -ne 66 ]; then
  # Kernels that scatter addresses more than the sanitizer expects stop it before main().
  if grep -q 'unexpected memory mapping' "$build/race.log"; then
    echo "SKIPPED: this kernel's address layout is too wide for the sanitizer"
    exit 77
  fi
  cat "$build/race.log"
  echo "the planted race was not found (status $status)"
  exit 1
fi

cd "$root" || exit 1
flags="-std=c++20 -O1 -g1 -fsanitize=thread -Wall -Wextra -Werror -Iinclude -Itests"
cached=$(command -v ccache || true)
{
  for block in bit_field cnc_channel map_table modbus_link modbus_map modbus_rows privileges real_time_thread \
    shdr_server simulated_cnc stop_request; do
    echo "src/hal/$block.cpp"
  done
  for block in text line_reader trace trace_time; do echo "src/io/$block.cpp"; done
  for test in $tests; do echo "tests/hal/test_$test.cpp"; done
} >"$build/sources"
sed "s|.*|$cached $compiler $flags -c & -o $build/\$(echo & \| tr / _).o|" "$build/sources" |
  xargs -P "$(nproc)" -d '\n' -n 1 sh -c || exit 1
objects=$(grep '^src/' "$build/sources" | tr / _ | sed "s|.*|$build/&.o|")
for test in $tests; do
  # Some tests count allocations with an operator new of their own.
  # shellcheck disable=SC2086 # a list
  "$compiler" -fsanitize=thread -Wl,--allow-multiple-definition \
    "$build/tests_hal_test_$test.cpp.o" $objects -lmodbus -pthread -o "$build/$test" || exit 1
  "$build/$test" || exit 1
  echo "no race in $test"
done
