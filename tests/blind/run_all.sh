#!/bin/sh
# The whole blind set on scoring seeds: tables, JSON and pictures. A run that was stopped goes on
# where it was, and whatever it has done is a fair sample of the whole: --summarise it at any time.
# usage: run_all.sh BLIND_SCORE SERVOSENSE FOLDER [full|tenth] [--round N] [--jobs N]
set -eu
score=$1
program=$2
folder=$3
shift 3
set=full
case "${1:-}" in full | tenth)
  set=$1
  shift
  ;;
esac
mkdir -p "$folder"
"$score" --program "$program" --results "$folder/rows.jsonl" --set "$set" --work "$folder/work" "$@"
# Seeds that were looked at give tables, too, once it has been said that they give no figures.
tables() {
  "$score" --summarise "$folder/rows.jsonl" --json "$folder/summary.json" --pictures "$folder" "$@" \
    >"$folder/summary.md"
}
tables || tables --development
cat "$folder/summary.md"
