#!/usr/bin/env bash
# Makes what is learned in the machine files of this folder: `identify idle` on the record behind each writes parameters,
# thresholds and what they were learned under. What is written by hand stays.
#   make.sh SERVOSENSE RECORDED_DATA            makes them anew, in place
#   make.sh SERVOSENSE RECORDED_DATA --check    says which figures differ by more than 0.1 %; status 1 when any does, 77 when no
#                                               record is there
# Records are looked for in $SERVOSENSE_DATA or ../shared/data; a file whose record is not there is passed over aloud.
set -euo pipefail
program=$1 convert=$2 mode=${3:-}
data=${SERVOSENSE_DATA:-../shared/data}
folder=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
made=0 differ=0

# file, set, trace of it, from which time on [s]
learn() {
  if [ ! -e "$data/$2/README.md" ]; then
    echo "SKIPPED: $1.ini, recorded set '$2' is not there (set SERVOSENSE_DATA to the folder that holds the sets)"
    return
  fi
  "$convert" "$(basename "$2")" "$data/$2" "$work/$1" >"$work/list"
  awk -F, -v from="$4" '/^[#t]/ || $1 >= from' "$work/$1/$3" >"$work/$1.csv"
  "$program" identify idle --quiet --machine "$folder/$1.ini" --trace "$work/$1.csv" --out "$work/$1.ini" >"$work/said"
  made=$((made + 1))
  if [ "$mode" != --check ]; then
    cp "$work/$1.ini" "$folder/$1.ini"
    echo "$1.ini made"
  elif awk -f - "$folder/$1.ini" "$work/$1.ini" <<'AWK'
    function bare(text) { sub(/#.*/, "", text); gsub(/^[ \t]+|[ \t]+$/, "", text); return text }
    FNR == 1 { ++file }
    /^\[/ { section = bare($0) }
    /^[a-z].*=/ {
      key = section " " bare(substr($0, 1, index($0, "=") - 1))
      value = bare(substr($0, index($0, "=") + 1))
      if (file == 1) { shipped[key] = value; next }
      was = shipped[key]
      number = was ~ /^[-+0-9.]/ && value ~ /^[-+0-9.]/
      apart = was - value; if (apart < 0) apart = -apart
      size = value < 0 ? -value : value + 0
      if (was == value || (was != "" && number && apart <= 1e-3 * size)) next
      print FILENAME ": " key " is shipped as '" was "', learned today as '" value "'"
      worse = 1
    }
    END { exit worse }
AWK
  then
    echo "$1.ini is what 'identify idle' learns"
  else
    echo "$1.ini: run $0 $program $convert"
    differ=1
  fi
}

# Behind the bundled excerpt, which ends at 98 s.
learn turnmill turnmill-production part_20181023_dev_main_air.csv 98

if [ $made -eq 0 ]; then exit 77; fi
exit $differ
