#!/usr/bin/env bash
# Programs run by LinuxCNC's own interpreter, task and trajectory planner, without hardware and without a screen; what it
# took is counted in servo periods.
#   motion.sh OUT_DIR PROGRAM[@FEED_OVERRIDE]...
# Writes OUT_DIR/<program>.csv, rows `line,end_s`. Exit status 77 when LinuxCNC is not there.
set -euo pipefail
source_dir=$(cd "$(dirname "$0")" && pwd)
for tool in linuxcnc halsampler setpriv; do
  command -v $tool >/dev/null || { echo "SKIPPED: $tool is not installed (linuxcnc-uspace)"; exit 77; }
done
out=$(realpath -m "$1")
shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$source_dir"/{motion.ini,motion.hal,record_motion.py} "$work"
for entry in "$@"; do
  program=${entry%@*}
  override=1
  [ "$program" = "$entry" ] || override=${entry##*@}
  name=$(basename "$program" .ngc)
  cp "$program" "$work/$name.ngc"
  echo "$work/$name.ngc $name.csv $override"
done >"$work/list.txt"
chmod -R a+rwX "$work"
as=()
[ "$(id -u)" -ne 0 ] || as=(setpriv --reuid 65534 --regid 65534 --clear-groups)  # it refuses root
(cd "$work" && HOME=$work RTAPI_FIFO_PATH=$work/fifo exec "${as[@]}" timeout 7200 linuxcnc -r motion.ini) \
  >"$work/log" 2>&1 || { cat "$work/log"; echo "failed: LinuxCNC"; exit 1; }
mkdir -p "$out"
for entry in "$@"; do
  name=$(basename "${entry%@*}" .ngc)
  [ -s "$work/$name.csv" ] || { cat "$work/log"; echo "failed: $name was not recorded"; exit 1; }
  cp "$work/$name.csv" "$out"
done
