#!/usr/bin/env bash
# The synthetic cut, learned and watched: chatter and collision are found, the air and the rest are silent.
#   check_main_job.sh SERVOSENSE SYNTHETIC_CUT
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$2" --idle "$work/idle.csv"
"$2" --cut "$work/cut.csv"
"$1" identify idle --quiet --machine examples/machines/koike_tc_s2c.ini --trace "$work/idle.csv" --out "$work/machine.ini"
"$1" monitor --quiet --machine "$work/machine.ini" --trace "$work/idle.csv" --events "$work/idle.jsonl"
"$1" monitor --quiet --machine "$work/machine.ini" --trace "$work/cut.csv" --events "$work/cut.jsonl" \
  --report "$work/cut.html" --estimates "$work/estimates.csv"
fail() { echo "failed: $1"; exit 1; }
grep -q '"state": *"alarm"' "$work/idle.jsonl" && fail "alarm in the air"
# Exactly one alarm of each kind, chatter while it grows (from 3 s), collision at the contact (6.65 s).
times() { grep "\"monitor\": *\"$1\"" "$work/cut.jsonl" | grep '"state": *"alarm"' | sed 's/.*"t_s": *\([0-9.]*\).*/\1/'; }
chatter=$(times chatter)
collision=$(times collision)
[ "$(echo "$chatter" | wc -w)" = 1 ] || fail "chatter alarms at: $chatter"
[ "$(echo "$collision" | wc -w)" = 1 ] || fail "collision alarms at: $collision"
awk -v t="$chatter" 'BEGIN { exit !(t > 3 && t < 4.2) }' || fail "chatter at $chatter s"
awk -v t="$collision" 'BEGIN { exit !(t > 6.64 && t < 6.66) }' || fail "collision at $collision s"
head -20 "$work/estimates.csv" | grep -q '^t_s,spindle.torque_Nm,x.force_N' || fail "columns of the estimates"
grep -q '<svg' "$work/cut.html" || fail "report without pictures"
echo "chatter alarm at $chatter s, collision alarm at $collision s, none in the air"
