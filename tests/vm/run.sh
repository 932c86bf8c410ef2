#!/usr/bin/env bash
# The CAN socket on a real kernel: boots Debian's in QEMU with vcan and runs can_socket_test there.
#   run.sh STATIC_TEST_PROGRAM
# Needs qemu-system-x86, busybox-static, cpio, g++ and Debian's kernel package, which is downloaded (70 MB) and
# kept in ~/.cache/servosense. Exit status 77 when the parts cannot be had.
set -euo pipefail
program=$1
cache=${XDG_CACHE_HOME:-$HOME/.cache}/servosense/vm
skip() { echo "SKIPPED: CAN on a real kernel: $1"; exit 77; }
for tool in qemu-system-x86_64 busybox cpio apt-get dpkg-deb; do
  command -v $tool >/dev/null || skip "$tool is not installed (qemu-system-x86, busybox-static, cpio, can-utils)"
done
[ "$(uname -m)" = x86_64 ] || skip "the machine is no x86-64"

if [ ! -e "$cache/vmlinuz" ]; then
  mkdir -p "$cache"
  download=$(mktemp -d)
  package=$(apt-cache depends linux-image-amd64 2>/dev/null | awk '/Depends: linux-image/{print $2; exit}')
  [ -n "$package" ] || skip "no kernel package is known (apt-get update)"
  (cd "$download" && apt-get download -qq "$package" 2>/dev/null) || skip "the kernel package cannot be downloaded"
  dpkg-deb --fsys-tarfile "$download"/linux-image*.deb | tar -x -C "$download" --wildcards \
    './boot/vmlinuz-*' './lib/modules/*/kernel/net/can/*' './lib/modules/*/kernel/drivers/net/can/*'
  find "$download/lib" \( -name can.ko -o -name can-raw.ko -o -name can-dev.ko -o -name vcan.ko \) -exec cp {} "$cache" \;
  cp "$download"/boot/vmlinuz-* "$cache/vmlinuz"
  rm -rf "$download"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/root/bin" "$work/root/mod"
cp "$(command -v busybox)" "$work/root/bin/busybox"
cp "$program" "$work/root/bin/can_socket_test"
cp "$cache"/*.ko "$work/root/mod"
# can-utils and the libraries they want, when they are there
for tool in candump canplayer; do
  path=$(command -v $tool) || continue
  cp "$path" "$work/root/bin"
  ldd "$path" | grep -o '/[^ ]*' | while read -r library; do
    mkdir -p "$work/root$(dirname "$library")"
    cp -L "$library" "$work/root$library"
  done
done
# Ends the machine with a status: QEMU's debug exit gives 2 n + 1.
printf '#include <stdlib.h>\n#include <sys/io.h>\nint main(int c, char** v) { iopl(3); outb(c > 1 ? (unsigned char)atoi(v[1]) : 0, 0xf4); return 0; }\n' >"$work/outb.c"
cc -O1 -static -o "$work/root/bin/outb" "$work/outb.c"
cat >"$work/root/init" <<'INIT'
#!/bin/busybox sh
/bin/busybox mkdir -p /proc /sys /dev /tmp
/bin/busybox --install -s /bin
export PATH=/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
for module in can-dev can can-raw vcan; do insmod /mod/$module.ko; done
ip link add dev vcan0 type vcan && ip link set vcan0 up
/bin/can_socket_test >/dev/ttyS1 2>&1
status=$?
echo "RC=$status" >/dev/ttyS1
sync
outb $((status == 0 ? 16 : 17))
INIT
chmod +x "$work/root/init"
(cd "$work/root" && find . | cpio -o -H newc --quiet | gzip -1) >"$work/initrd.gz"
status=0
timeout 300 qemu-system-x86_64 -accel tcg -cpu max -m 256 -nodefaults -display none -no-reboot \
  -serial "file:$work/console.txt" -serial "file:$work/result.txt" -device isa-debug-exit,iobase=0xf4,iosize=0x04 \
  -kernel "$cache/vmlinuz" -initrd "$work/initrd.gz" -append "console=ttyS0 quiet panic=-1 mitigations=off" || status=$?
tr -d '\r' <"$work/result.txt"
# 33 is our own way out; a panic ends with 0, which is no pass.
if [ $status -eq 33 ] && tr -d '\r' <"$work/result.txt" | grep -qx 'RC=0'; then exit 0; fi
echo "failed: the machine ended with status $status"
tail -n 20 "$work/console.txt"
exit 1
