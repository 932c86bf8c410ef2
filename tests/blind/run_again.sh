#!/bin/sh
# What a first run has written into the machine file is no longer missing: a second run on the same
# record names nothing. usage: run_again.sh BLIND_CASES SERVOSENSE FOLDER
set -eu
rm -rf "$3"
# also CELL/EFFECT SEED
again() {
  "$1" --case "$4" --seed "$5" --out "$3/case" > /dev/null
  "$2" reconcile --quiet --machine "$3/case/machine.ini" --trace "$3/case/trace.csv" --out "$3/first" > /dev/null
  grep -q '"effects": \[$' "$3/first/reconcile.json"
  "$2" reconcile --quiet --machine "$3/first/machine.ini" --trace "$3/case/trace.csv" --out "$3/second" \
    > "$3/said.txt"
  grep -q '"effects": \[\]' "$3/second/reconcile.json" || {
    echo "$4 $5:"
    cat "$3/said.txt"
    exit 1
  }
}
again "$1" "$2" "$3" spindle/single/encoder-eccentricity 2516
again "$1" "$2" "$3" drive/single/backlash 2623
again "$1" "$2" "$3" milling/single/pitch-error 2621
again "$1" "$2" "$3" drive/single/torque-ripple 2621
again "$1" "$2" "$3" drive/single/stribeck-friction 2623
again "$1" "$2" "$3" drive/single/flexible-coupling 2621
