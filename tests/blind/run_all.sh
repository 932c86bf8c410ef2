#!/bin/sh
# The whole blind set on scoring seeds: tables, JSON and pictures. A run that was stopped goes on
# where it was, and whatever it has done is a fair sample of the whole: --summarise it at any time.
# usage: run_all.sh BLIND_SCORE SERVOSENSE FOLDER [full|tenth] [--round N] [--jobs N]
set -eu
score=$1
program=$2
folder=$3
shift 3
# Without a round it is the first one, which keeps what was reached and gives no figures.
case " $* " in *" --round "*) seen= ;; *) seen=--development ;; esac
set=full
case "${1:-}" in full | tenth)
  set=$1
  shift
  ;;
esac
mkdir -p "$folder"
"$score" --program "$program" --results "$folder/rows.jsonl" --set "$set" --work "$folder/work" "$@"
"$score" --summarise "$folder/rows.jsonl" --json "$folder/summary.json" --pictures "$folder" $seen \
  >"$folder/summary.md"
cat "$folder/summary.md"
