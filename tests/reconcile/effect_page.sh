#!/bin/sh
# Follows "To add one" of docs/effects.md to the letter: its file and its patch, on a copy of the
# headers; then what depends on the list of effects is compiled, and the new effect must be found.
# usage: effect_page.sh WORK_FOLDER CXX EIGEN_INCLUDE LIBSERVOSENSE   (in the source folder)
set -eu
work=$1
cxx=$2
eigen=$3
library=$4
rm -rf "$work"
mkdir -p "$work/include/servosense/model/effects" "$work/include/servosense/core"
cp include/servosense/core/effect_keys.hpp "$work/include/servosense/core/"
cp include/servosense/model/drive_effects.hpp "$work/include/servosense/model/"
block() { awk -v fence="\`\`\`$1" '/^## /{on=($0=="## To add one")} on&&$0==fence{p=1;next} p&&/^```/{exit} p' docs/effects.md; }
block cpp >"$work/include/servosense/model/effects/chain_load.hpp"
block diff >"$work/list.diff"
(cd "$work" && patch -p0 -s <list.diff)
launcher=$(command -v ccache || true)
objects=
compile() {
  $launcher "$cxx" -std=c++20 -O1 -I"$work/include" -Iinclude -Isrc -Itests -isystem "$eigen" -c "$1" -o "$2"
}
# Two at a time. These alone know the list; the rest comes from the library.
for source in src/reconcile/drive/candidates/*.cpp src/reconcile/drive/response.cpp \
  src/reconcile/drive/backlash_response.cpp src/sim/drive_simulator.cpp tests/reconcile/effect_page.cpp; do
  object="$work/$(basename "$source" .cpp).o"
  objects="$objects $object"
  compile "$source" "$object" &
  if [ -n "${before:-}" ]; then
    wait "$before"
  fi
  before=$!
done
wait "$before"
"$cxx" $objects "$library" -pthread -o "$work/effect_page"
"$work/effect_page"
