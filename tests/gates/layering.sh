#!/bin/sh
# Layering gate: every #include of include/ and src/ is one that the table of rooms in
# docs/contributing.md allows, and the table allows none upward. What is planted must be refused.
#   layering.sh   (in the source folder)
set -eu
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT

# judge ROOT: the includes of the tree there, against the table.
judge() {
  (cd "$1" && {
    grep '^| [0-9] |' docs/contributing.md
    grep -rn '^ *# *include' include/servosense src
  }) | awk '
    /^\|/ {
      split($0, column, "|")
      floor = column[2] + 0
      match(column[3], /[a-z]+/)
      room = substr(column[3], RSTART, RLENGTH)
      floors[room] = floor
      rest = column[4]
      if (rest ~ /Eigen/) allowed[room, "Eigen"] = 1
      if (rest ~ /libmodbus/) allowed[room, "modbus"] = 1
      while (match(rest, /`[^`]*`/)) {
        name = substr(rest, RSTART + 1, RLENGTH - 2)
        allowed[room, name] = 1
        if (name !~ /\//) listed[room, name] = 1
        rest = substr(rest, RSTART + RLENGTH)
      }
      next
    }
    function refuse(why) { print file ": " why; bad = 1 }
    {
      file = $0
      sub(/:.*/, "", file)
      split(file, part, "/")
      room = part[1] == "src" ? part[2] : part[3]
      if (!(room in floors)) { refuse("room " room " is not in the table"); next }
      what = $0
      sub(/^[^<"]*[<"]/, "", what)
      sub(/[>"].*/, "", what)
      ++seen
      if (what ~ /^(Eigen|unsupported)\//) {
        if (!((room, "Eigen") in allowed)) refuse(room " includes Eigen")
      } else if (what ~ /^modbus/ || what ~ /^linux\/can/) {
        if (!((room, "modbus") in allowed)) refuse(room " includes " what)
      } else if (what ~ /^servosense\//) {
        sub(/^servosense\//, "", what)
        other = what
        sub(/\/.*/, "", other)
        if (other != room && !((room, other) in allowed) && !((room, what) in allowed))
          refuse(room " includes " what)
      } else if ($0 ~ /"/) {
        # A file beside it: up to the folder of the room, and no further.
        depth = split(file, part, "/") - (part[1] == "src" ? 3 : 4)
        up = gsub(/\.\.\//, "&", what)
        if (up > depth) refuse("leaves its room: " what)
      }
    }
    END {
      for (pair in listed) {
        split(pair, of, SUBSEP)
        if (!(of[2] in floors) || floors[of[2]] >= floors[of[1]]) {
          print "the table lets " of[1] " include " of[2] ", which is no room on a lower floor"
          bad = 1
        }
      }
      if (seen < 10) { print "no includes found"; bad = 1 }
      exit bad
    }'
}

judge . || exit 1

# plant FILE LINE
plant() {
  rm -rf "$work/tree"
  mkdir -p "$work/tree"
  cp -r include src "$work/tree/"
  mkdir "$work/tree/docs"
  cp docs/contributing.md "$work/tree/docs/"
  echo "$2" >>"$work/tree/$1"
  if judge "$work/tree" >"$work/said"; then
    echo "let pass in $1: $2"
    exit 1
  fi
}
plant include/servosense/core/status.hpp '#include "servosense/dsp/biquad.hpp"'
plant src/sim/trajectory.cpp '#include "servosense/observer/disturbance_observer.hpp"'
plant src/io/json.cpp '#include <Eigen/Core>'
plant src/io/json.cpp '#include "../dsp/anything.hpp"'
plant docs/contributing.md '| 2 | `model` | `observer` |'
echo "every include is in the table; the planted ones were refused"
