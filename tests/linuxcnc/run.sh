#!/usr/bin/env bash
# The LinuxCNC component, built by halcompile and run in halrun without hardware, at 8 kHz and at 1 kHz: a stream goes
# in, samples come out, and must be what the C interface gives for the same numbers.
#   run.sh SOURCE_DIR BUILD_DIR
# Installs the component among LinuxCNC's modules. Exit status 77 when LinuxCNC is not there.
set -euo pipefail
source_dir=$(realpath "$1")
build=$(realpath -m "$2")
for tool in halcompile halrun halstreamer halsampler; do
  command -v $tool >/dev/null || { echo "SKIPPED: $tool is not installed (linuxcnc-uspace, linuxcnc-uspace-dev)"; exit 77; }
done
[ "$(id -u)" -eq 0 ] || { echo "SKIPPED: installing a component needs root"; exit 77; }

# A module is a shared object: the libraries must be made for one.
cmake -S "$source_dir" -B "$build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_POSITION_INDEPENDENT_CODE=ON \
  -DSERVOSENSE_TESTS=OFF -DSERVOSENSE_BENCH=OFF -DSERVOSENSE_EXAMPLES=OFF -DSERVOSENSE_HAL=OFF >/dev/null
cmake --build "$build" --target servosense_c_files
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$source_dir/src/linuxcnc/servosense.comp" "$source_dir/tests/linuxcnc/machine.ini" "$work"
mkdir "$work/servosense"
cp -r "$source_dir/include/servosense/capi" "$work/servosense"  # halcompile looks beside the component
cd "$work"
# The library's objects must come whole: a module has no main that asks for them.
LDFLAGS="-Wl,--whole-archive $build/libservosense_c_files.a $build/libservosense_c.a -Wl,--no-whole-archive $build/libservosense.a -lstdc++ -lm" \
  halcompile --install servosense.comp >halcompile.log 2>&1 || { cat halcompile.log; exit 1; }
cc -I"$source_dir/include" -O1 "$source_dir/tests/linuxcnc/expected.c" "$build/libservosense_c_files.a" \
  "$build/libservosense_c.a" "$build/libservosense.a" -lstdc++ -lm -lpthread -o expected

# halrun refuses root: real-time tasks run as nobody.
export RTAPI_UID=65534 RTAPI_FIFO_PATH=$work/rtapi_fifo
chmod 777 "$work"
status=0
for period in 125000 1000000; do
  # 6000 rpm with a torque that begins to swing at 80 Hz beside the harmonics; x runs into something.
  awk -v T=$period 'BEGIN { for (n = 0; n < 3000; ++n) { t = n * T * 1e-9; total = 3000 * T * 1e-9;
      swing = t > 0.4 * total ? 16 * sin(6.2831853 * (T > 500000 ? 80.3 : 771.3) * t) : 0;
      push = t > 0.8 * total ? (t - 0.8 * total) * 4e5 : 0; if (push > 4000) push = 4000;
      resume = (n > 0.7 * 3000 && n < 0.75 * 3000) || n > 0.95 * 3000;
      printf "%.9f %.6f %.9f %.6f %d\n", 100 * t, 0.8 + swing, 50 * t, (94 + 36.6 + push) * 0.016 / 6.2831853 / 0.8, resume } }' >input.txt
  ./expected $period machine.ini <input.txt >expected.txt
  cat >test.hal <<HAL
loadrt threads name1=servo period1=$period
loadrt streamer depth=4000 cfg=ffffb
loadrt servosense config=$work/machine.ini period_ns=$period axes=1
loadrt sampler depth=4000 cfg=ffbbb
addf streamer.0 servo
addf servosense servo
addf sampler.0 servo
net a streamer.0.pin.0 servosense.spindle-revs
net b streamer.0.pin.1 servosense.spindle-current
net c streamer.0.pin.2 servosense.axis-0-pos
net d streamer.0.pin.3 servosense.axis-0-current
net e servosense.spindle-torque sampler.0.pin.0
net f servosense.axis-0-force sampler.0.pin.1
net g servosense.chatter sampler.0.pin.2
net h servosense.collision sampler.0.pin.3
net i streamer.0.pin.4 servosense.resume
net j servosense.feed-hold sampler.0.pin.4
loadusr -w halstreamer $work/input.txt
start
loadusr -w halsampler -n 3000 $work/samples.txt
HAL
  timeout 120 halrun -f test.hal >halrun.log 2>&1 || { cat halrun.log; echo "failed: halrun at $period ns"; exit 1; }
  # The sampler may begin before the stream and end behind it: the stream is looked for in the samples.
  if ! awk -v period=$period '
    NR == FNR { expected[++count] = $0; next }
    { got[++lines] = $0 }
    function near(a, b, size) { d = a - b; if (d < 0) d = -d; return d <= 1e-4 + 1e-5 * size }
    END {
      for (shift = 0; shift <= 50; ++shift) {
        bad = 0; compared = 0
        for (n = 1; n + shift <= lines && n <= count; ++n) {
          split(expected[n], e, " "); split(got[n + shift], g, " ")
          if (!near(e[1], g[1], 20) || !near(e[2], g[2], 4000) || e[3] != g[3] || e[4] != g[4] || e[5] != g[5]) { bad = 1; break }
          ++compared; alarms += e[3] + e[4]
        }
        if (!bad && compared >= 2900) { print period " ns: " compared " samples as expected, " shift " before the stream"; exit 0 }
      }
      print "failed at " period " ns: the samples are not those expected"; exit 1
    }' expected.txt samples.txt; then
    status=1
    paste expected.txt samples.txt | sed -n '1,3p;1500,1503p'
  fi
  for column in 3 4 5; do
    awk -v c=$column '$c == 1 { found = 1 } END { exit !found }' expected.txt || { echo "failed: nothing alarmed in column $column at $period ns"; status=1; }
  done
  # Held, resumed while the chatter still sounds, held again for the contact, resumed.
  awk 'NR > 1 && $5 != before { ++changes } { before = $5 } END { exit !(changes == 4) }' expected.txt ||
    { echo "failed: the feed is not held twice at $period ns"; status=1; }
done
exit $status
