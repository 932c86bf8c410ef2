#!/usr/bin/env bash
# Every recorded set that carries drive signals goes through `monitor` at its own rate. Sets that are not there are skipped
# aloud; the bundled excerpt always runs.
#   check_recorded_data.sh SERVOSENSE RECORDED_DATA
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
data=${SERVOSENSE_DATA:-../shared/data}
fail() { echo "failed: $1"; exit 1; }
watch() {  # machine, trace
  local machine=examples/machines/$2.ini
  # The sensor of another maker on the same mill, at 8 kHz.
  if [[ $3 == */PCB_* ]]; then
    sed 's/^sample_rate_hz = .*/sample_rate_hz = 8000/' "$machine" >"$work/pcb.ini"
    machine=$work/pcb.ini
  fi
  # Three joints of the robot as axes.
  [[ $3 == */ur-*_axes* ]] && machine=examples/machines/ur10e_arm.ini
  "$1" monitor --quiet --json --machine "$machine" --trace "$3" >"$work/out.json" || fail "$3"
  echo "$(basename "$3"): $(grep -c '"runs": true' "$work/out.json" || true) monitor(s) run, $(sed -n 's/.*"alarms": \([0-9]*\).*/\1/p' "$work/out.json") alarm(s)"
}
watch "$1" turnmill tests/data/turnmill/part_excerpt.csv
# set:machine[:ending of the traces that hold a drive]
for entry in emps:emps turnmill-production:turnmill umich-cnc-mill:umich turning-torque-force:turning:_drives \
  nolicence/servo-torque-hsm150:hsm150 nolicence/lugre-servo-motor:lugre_servo nolicence/ur10e-friction-collision:ur10e \
  nolicence/saw-chatter-servo:saw nolicence/milling-chatter-audio:milling_audio \
  nolicence/mill-vibration-hurco:mill_vibration nolicence/tool-edge-damage-currents:tool_edge; do
  IFS=: read -r set machine ending <<<"$entry"
  if [ ! -e "$data/$set/README.md" ]; then
    echo "SKIPPED: recorded set '$set' is not there (set SERVOSENSE_DATA to the folder that holds the sets)"
    continue
  fi
  "$2" "$(basename "$set")" "$data/$set" "$work/$machine" >"$work/list"
  for trace in "$work/$machine"/*"$ending".csv; do watch "$1" "$machine" "$trace"; done
done
