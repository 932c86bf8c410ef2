#!/usr/bin/env bash
# The command channel on a real LinuxCNC that runs without hardware and without a screen.
#   cnc.sh TEST_PROGRAM [ARGUMENT...]
# Exit status 77 when LinuxCNC is not there.
set -euo pipefail
source_dir=$(cd "$(dirname "$0")" && pwd)
port=5107
for tool in linuxcnc linuxcncrsh setpriv; do
  command -v $tool >/dev/null || { echo "SKIPPED: $tool is not installed (linuxcnc-uspace)"; exit 77; }
done
work=$(mktemp -d)
cp "$source_dir/cnc.ini" "$source_dir/cnc.hal" "$work"
chmod 777 "$work"
as=()
[ "$(id -u)" -ne 0 ] || as=(setpriv --reuid 65534 --regid 65534 --clear-groups)  # it refuses root
(cd "$work" && HOME=$work RTAPI_FIFO_PATH=$work/fifo exec "${as[@]}" timeout 900 linuxcnc cnc.ini) \
  >"$work/log" 2>&1 &
linuxcnc=$!
end() {
  # linuxcncrsh is its screen: LinuxCNC ends with it, in good order.
  printf 'hello EMC end 1.0\r\nset enable EMCTOO\r\nshutdown\r\n' >&3 2>/dev/null || true
  wait $linuxcnc 2>/dev/null || true
  rm -rf "$work"
}
for _ in $(seq 100); do
  (exec 3<>/dev/tcp/127.0.0.1/$port) 2>/dev/null && break
  kill -0 $linuxcnc 2>/dev/null || { cat "$work/log"; echo "failed: LinuxCNC does not start"; exit 1; }
  sleep 0.2
done
exec 3<>/dev/tcp/127.0.0.1/$port
trap end EXIT
# As an operator would in the morning.
printf '%s\r\n' 'hello EMC operator 1.0' 'set enable EMCTOO' 'set estop off' 'set machine on' \
  'set home 0' 'set home 1' 'set home 2' >&3
sleep 1.5
SERVOSENSE_LINUXCNC=linuxcnc://127.0.0.1:$port "$@"
