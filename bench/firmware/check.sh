#!/bin/sh
# Firmware gates: builds the real-time core for a Cortex-M, refuses symbols that it must not have,
# measures how deep the C interface goes on the stack, runs the firmware example under QEMU and holds its alarms against those of this computer, counts
# the instructions of every block under QEMU and holds them against instructions.csv.
#   check.sh m4|m7 [--build DIR] [--update]
# --update writes what was counted into the table. Status: 0 all holds, 1 a gate is broken, 2 wrong
# usage, 77 skipped (a tool is absent, or the table was made with another compiler).
set -eu

here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
core=${1:-}
[ $# -gt 0 ] && shift
build=$root/build/check-firmware-$core
update=no
case $core in
  m4) machine=mps2-an386 ;;
  m7) machine=mps2-an500 ;;
  *) echo "usage: check.sh m4|m7 [--build DIR] [--update]" >&2; exit 2 ;;
esac
while [ $# -gt 0 ]; do
  case $1 in
    --build) build=$2; shift 2 ;;
    --update) update=yes; shift ;;
    *) echo "check.sh: unknown option $1" >&2; exit 2 ;;
  esac
done

for tool in cmake ${CC:-cc} ${CXX:-c++} arm-none-eabi-gcc arm-none-eabi-g++ arm-none-eabi-nm arm-none-eabi-objdump qemu-system-arm; do
  command -v $tool >/dev/null || { echo "SKIPPED: $tool is not installed"; exit 77; }
done

quietly() { "$@" >"$build/log" 2>&1 || { cat "$build/log"; echo "failed: $*"; exit 1; }; }
mkdir -p "$build"
quietly cmake -S "$root" -B "$build" -DCMAKE_TOOLCHAIN_FILE="$root/cmake/arm-none-eabi.cmake" \
  -DCMAKE_BUILD_TYPE=Release -DSERVOSENSE_FIRMWARE=ON -DSERVOSENSE_CORE=$core
quietly cmake --build "$build"
echo "$core: built without exceptions and RTTI$([ $core = m7 ] || echo ", every real-time header alone")"

blocks=$(find "$build" -name 'block_table.cpp.obj')
planted=$(find "$build" -name 'planted_violation.cpp.obj')
symbols=$root/tests/gates/symbols.sh
"$symbols" arm-none-eabi-nm "$blocks" || exit 1
if "$symbols" arm-none-eabi-nm "$planted" >"$build/planted.txt"; then
  echo "$core: the symbol gate let the planted violation pass"
  exit 1
fi

sizes() {
  arm-none-eabi-nm -S "$1" >"$build/symbols.txt"
  arm-none-eabi-objdump -dr --no-show-raw-insn "$1" >"$build/code.txt"
  awk -f "$here/code_size.awk" "$build/symbols.txt" "$build/code.txt"
}
sizes "$blocks" >"$build/sizes.csv" || exit 1
if sizes "$planted" >>"$build/planted.txt" 2>&1; then
  echo "$core: a block that calls the mathematics library was let pass"
  exit 1
fi
echo "$core: no forbidden symbol or call; the planted ones were refused"

# emulate ELF OUTPUT [QEMU OPTION...]
emulate() {
  elf=$1 output=$2
  shift 2
  timeout 300 qemu-system-arm -M $machine -display none -monitor none -serial none \
    -chardev file,id=out,path="$output" \
    -semihosting-config enable=on,target=native,chardev=out "$@" -kernel "$elf" ||
    { cat "$output"; echo "$core: $(basename "$elf") did not end well"; exit 1; }
}

# The same alarms, to the millisecond. The size of the storage is each machine's own.
emulate "$build/bench/firmware/alarms.elf" "$build/alarms_board.txt"
quietly ${CXX:-c++} -std=c++20 -O2 -I "$root/include" -c "$root/src/capi/servosense.cpp" \
  -o "$build/servosense_c.o"
quietly ${CXX:-c++} -std=c++20 -O2 -I "$root/include" -c "$root/src/capi/override.cpp" \
  -o "$build/override_c.o"
quietly ${CC:-cc} -O2 -I "$root/include" -c "$root/examples/firmware/alarms.c" -o "$build/alarms.o"
quietly ${CXX:-c++} "$build/alarms.o" "$build/servosense_c.o" "$build/override_c.o" -o "$build/alarms_host"
"$build/alarms_host" >"$build/alarms_host.txt" ||
  { cat "$build/alarms_host.txt"; echo "$core: the example did not end well on this computer"; exit 1; }
for side in board host; do
  grep ' ms: ' "$build/alarms_$side.txt" >"$build/alarms_$side.only" ||
    { echo "$core: the example raises no alarm on the $side"; exit 1; }
done
diff "$build/alarms_host.only" "$build/alarms_board.only" ||
  { echo "$core: the example's alarms (>) are not those of this computer (<)"; exit 1; }
echo "$core: alarms of examples/firmware as on this computer: $(tr '\n' ',' <"$build/alarms_board.only" | sed 's/,$//; s/,/, /g')"

# servosense_init and servosense_process, each in less than its share of a controller's stack.
emulate "$build/bench/firmware/stack_depth.elf" "$build/stack.txt"
sed "s/^/$core: /" "$build/stack.txt"

# Twice: a count that does not repeat is none.
for run in first second; do
  emulate "$build/bench/firmware/firmware.elf" "$build/$run.csv" -icount shift=8
done
cmp "$build/first.csv" "$build/second.csv" || { echo "$core: two runs differ"; exit 1; }
awk -F, 'FNR == NR { bytes[$1] = $2; next }
         !($1 in bytes) { print "no code size for " $1 > "/dev/stderr"; exit 1 }
         { print $0 "," bytes[$1] }' "$build/sizes.csv" "$build/first.csv" >"$build/counted.csv"

table=$here/instructions.csv
compiler="# arm-none-eabi-g++ $(arm-none-eabi-g++ -dumpfullversion), -O2"
columns=block,core,mean,worst,code_bytes
if [ $update = yes ]; then
  touch "$table"
  { echo "$compiler"
    echo "$columns"
    { cat "$build/counted.csv"; awk -F, -v core=$core '/^[a-z]/ && $2 ~ /^m[47]$/ && $2 != core' "$table"
    } | sort -t, -k2,2 -s; } >"$build/table.csv"
  cp "$build/table.csv" "$table"
fi
echo "$columns"
cat "$build/counted.csv"
if ! made_with=$(grep '^# arm-none-eabi-g++ ' "$table" 2>/dev/null); then
  echo "$core: $table is absent or does not name its compiler; --update makes it"
  exit 1
fi
if [ "$made_with" != "$compiler" ]; then
  echo "SKIPPED: the table was made with ${made_with#\# }, this is ${compiler#\# }"
  exit 77
fi
awk -v core=$core -f "$here/compare.awk" "$table" "$build/counted.csv" || exit 1
echo "$core: instructions as in the table"
