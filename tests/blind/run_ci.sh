#!/bin/sh
# A few scoring cases: no name may be wrong. usage: run_ci.sh BLIND_SCORE SERVOSENSE FOLDER [SET]
set -eu
rm -rf "$3"
mkdir -p "$3"
"$1" --program "$2" --results "$3/rows.jsonl" --set "${4:-eighth}" --work "$3/work" --no-comparator
"$1" --summarise "$3/rows.jsonl" --json "$3/summary.json" --development
"$1" --accept "$3/rows.jsonl"
