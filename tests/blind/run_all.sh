#!/bin/sh
# The whole blind set on scoring seeds: tables as text and JSON. Stopped runs go on where they were.
# usage: run_all.sh BLIND_SCORE SERVOSENSE FOLDER [full|tenth]
set -eu
mkdir -p "$3"
"$1" --program "$2" --results "$3/rows.jsonl" --set "${4:-full}" --work "$3/work"
# The same name when units are scaled, the axis is reversed, rows decimated, the zero moved.
"$1" --program "$2" --results "$3/rows.jsonl" --cases drive/single,drive/null --seeds 200000:1 \
  --variants --no-comparator --work "$3/work"
"$1" --summarise "$3/rows.jsonl" --json "$3/summary.json" | tee "$3/summary.txt"
