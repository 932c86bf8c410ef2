#!/usr/bin/env bash
# Every recorded set with signals of a drive by commands alone: imported, learned from, watched. Prints what was asked, said
# and true, and fails where something else is said, or a row is not that of docs/recorded-data.md. Sets that are not there
# are skipped aloud.
#   recorded_sets.sh SERVOSENSE
set -euo pipefail
program=$(realpath "$1")
page=$(realpath "$(dirname "$0")/../docs/recorded-data.md")
data=$(realpath -m "${SERVOSENSE_DATA:-../shared/data}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
failed=0 done=0

there() {  # SET
  [ -e "$data/$1/README.md" ] && done=$((done + 1)) && return
  echo "SKIPPED: recorded set '$1' is not there (set SERVOSENSE_DATA to the folder that holds the sets)"
  return 1
}
machine() {  # FILE RATE, further lines from standard input
  { printf '[machine]\nname = %s\nsample_rate_hz = %s\n' "$1" "$2" && cat; } >"$1.ini"
}
import() { "$program" import --quiet "$@" >import.txt || { cat import.txt && exit 1; }; }
learn() {  # MACHINE TRACE: MACHINE_learned.ini; what is said goes to said.txt
  "$program" identify idle --machine "$1.ini" --trace "$2.trace" --out "$1_learned.ini" >said.txt 2>&1 || true
}
watch() { "$program" monitor --quiet --machine "$1.ini" --trace "$2.trace" >said.txt 2>&1 || true; }  # MACHINE TRACE
figure() { awk -v what="$1" 'index($0, "  " what) == 1 { sub("  " what, ""); printf "%.4g", $1; exit }' said.txt; }  # WHAT
row() {  # SET ASKED SAID TRUE
  local text="| $1 | $2 | $3 | $4 |"
  echo "$text"
  grep -qF -- "$text" "$page" || { echo "failed: $page has no such row" && failed=1; }
}
within() {  # WHAT VALUE LEAST MOST
  awk -v v="${2:-nan}" -v a="$3" -v b="$4" 'BEGIN { exit !(v >= a && v <= b) }' && return
  echo "failed: $1 is '$2', expected $3 to $4" && failed=1
}
says() {  # WORDS: they are in what was said
  grep -qF -- "$1" said.txt && return
  echo "failed: expected '$1' in:" && head -5 said.txt && failed=1
}
# Distances of the windows that are compared with a sound reference, from FROM seconds on.
distances() {  # MACHINE TRACE [FROM_S]
  "$program" monitor --quiet --machine "$1.ini" --trace "$2.trace" --json |
    awk -v from="${3:-0}" -v RS='{' '/"from_s"/ && match($0, /"distance": [0-9.e+-]+/) {
      d = substr($0, RSTART + 12, RLENGTH - 12)
      match($0, /"from_s": [0-9.e+-]+/)
      if (substr($0, RSTART + 10, RLENGTH - 10) + 0 >= from + 0) print d }'
}
# How often an event is farther than a sound window, and the 95 % interval: that of DeLong (1988), of stretches of five
# windows since neighbours are alike (Obuchowski 1997). Further pairs of files: the mean over the pairs.
area() {  # EVENTS SOUND [EVENTS SOUND]...
  awk 'FNR == 1 { ++files; n[files] = 0 } { v[files, ++n[files]] = $1 }
    function spread(of, size,   i, sum, all) {
      for (i = 1; i <= size; ++i) {
        sum += won[of, i] - a
        if (i % 5 == 0 || i == size) { all += sum * sum; sum = 0 }
      }
      return all / size / size
    }
    END {
      for (f = 1; f < files; f += 2) {
        split("", won)
        a = 0
        for (i = 1; i <= n[f]; ++i)
          for (j = 1; j <= n[f + 1]; ++j) {
            w = v[f, i] > v[f + 1, j] ? 1 : v[f, i] == v[f + 1, j] ? 0.5 : 0
            won[1, i] += w / n[f + 1]; won[2, j] += w / n[f]; a += w / n[f] / n[f + 1]
          }
        mean += a; variance += spread(1, n[f]) + spread(2, n[f + 1]); ++pairs
      }
      mean /= pairs; e = 1.96 * sqrt(variance) / pairs
      printf "%.2f (%.2f to %.2f)", mean, mean - e, mean + e < 1 ? mean + e : 1
    }' "$@"
}
better_than_chance() {  # WHAT AREA
  within "$1, least of the interval" "$(sed 's/.*(\(.*\) to .*/\1/' <<<"$2")" 0.5 1
}
verdict() { sed -n 's/^Verdict: \([a-z-]*\)\..*/\1/p' said.txt; }
alarms() { sed -n 's/^Verdict: .* \([0-9]*\) alarms\{0,1\}, .*/\1/p' said.txt; }

echo "| set | asked | said | true |"
echo "|---|---|---|---|"

if there emps; then
  machine emps 1000 <<<$'[axis.x]\nlead_m = 0.0025\nencoder_counts_per_rev = 50000\neffort_column = x.voltage_V\nforce_constant_N_per_A = 35.15065'
  for name in train pulses_dev; do
    import "$data/emps/emps_$name.csv" --out $name.trace --column x.command_position_m=qg_m:m --column x.position_m=qm_m:m --column x.voltage_V=vir_V:V
  done
  learn emps train
  mass=$(awk -v v="$(figure 'equivalent mass')" 'BEGIN { printf "%.2f", 35.15065 * v }')
  within "mass" "$mass" 94.5 95.7
  row emps "moving mass from the voltage of the controller" "$mass kg (V s2/m times 35.15 N/V)" "95.11 +- 0.11 kg published"
  watch emps_learned pulses_dev
  hits=$(alarms)
  within "alarms" "$hits" 18 25
  # The load steps every 0.5 s from 0.344 s on.
  within "alarms elsewhere" "$(awk '/ s  alarm / { p = ($1 - 0.344) % 0.5; n += p > 0.02 } END { print n + 0 }' said.txt)" 0 0
  row "" "contacts in the second record" "$hits alarms, all at one; the rest are warnings" "25 steps of a known load of 176 N, and nothing else"
fi

if there turnmill-production; then
  machine turnmill 1000 <<<$'[spindle]\ncurrent_is_unsigned = yes\ncurrent_is_ratio = yes\ntorque_constant_Nm_per_A = 1\n[spindle2]\ncurrent_is_unsigned = yes\ncurrent_is_ratio = yes\ntorque_constant_Nm_per_A = 1'
  columns=(--only --column spindle.current_A=current_main:A --column spindle2.current_A=current_sub:A
    --column spindle.speed_rad_s=speed_main:rpm --column spindle2.speed_rad_s=speed_sub:rpm)
  import "$data/turnmill-production/part_20181023_dev.f32" --out part.trace "${columns[@]}"
  import "$data/turnmill-production/part_20181023_dev.f32" --out air.trace "${columns[@]}" --where cut_signal=0 --apart 0.2
  learn turnmill part
  says "something is cut"
  row turnmill-production "idling run from a part that is cut" "refused: something is cut" "it is"
  learn turnmill air
  base=$(figure 'base speed')
  within "base speed" "$base" 150 260
  row "" "the same, without what the cut flag marks" "inertia and friction of both spindles; the second loses torque beyond $base rad/s" "plain differences: 0.49 of the torque per ampere beyond 350 rad/s"
  watch turnmill_learned part
  hits=$(alarms)
  within "alarms" "$hits" 0 2
  row "" "chatter, tool 8 to 57" "$hits alarms of the spindle in 122 s" "no fault is known; they come while it brakes"
  machine slide 1000 <<<$'[axis.z]\nrated_torque_Nm = 1\nlead_m = 0.01'
  import "$data/turnmill-production/segments_1574906106_dev.f32" --out slide.trace --only --column z.following_error_m=error_z:mm \
    --column z.command_torque_percent=tcmd_z:%
  watch slide slide
  says "but no motion"
  row "" "torque command and following error of z" "not watched: no motion" "a following error tells it beside the command, which was not recorded"
fi

if there umich-cnc-mill; then
  machine umich 10 <<<$'[axis.x]\nforce_constant_N_per_A = 1\ncurrent_is_ratio = yes'
  import "$data/umich-cnc-mill/experiment_01.csv" --out umich.trace --rate 10 --only --column x.position_m=X1_ActualPosition:mm \
    --column x.current_A=X1_CurrentFeedback:A
  learn umich umich
  says "does not show the inertia"
  row umich-cnc-mill "inertia and friction at 10 Hz" "the record does not show the inertia; running current $(figure 'running effort') A" "moves of 0.1 s are one sample"
  watch umich_learned umich
  says "slow signal"
  row "" "collision" "not watched: needs 500 Hz" "nothing is known"
fi

if there turning-torque-force; then
  machine turning 1 <<<$'[spindle]\nconstant_speed_rpm = 1000'
  import "$data/turning-torque-force/segments_1s.csv" --out turning.trace --rate 1 --only --column spindle.torque_Nm=TV2.S_MEAN:Nm
  watch turning turning
  says "too slow to tell anything of a drive"
  row turning-torque-force "anything" "refused: rows 1 s apart are too slow" "means over a second: for the wear monitor as passes, through the library"
fi

if there nolicence/servo-torque-hsm150; then
  machine hsm150 1000 <<<$'[spindle]'
  for name in neg_0.045_1 pos_0.065_1; do
    import "$data/nolicence/servo-torque-hsm150/idf_$name.f32" --out $name.trace --only --column spindle.angle_rad=position:rad --column spindle.torque_Nm=torque_in:Nm
  done
  learn hsm150 neg_0.045_1
  says "the motion explains too little of the effort"
  row servo-torque-hsm150 "inertia and friction, torque to -0.045 Nm" "refused: the motion explains too little" "the publishers' constants leave a mean of 0.02 to 0.04 Nm: half the torque"
  learn hsm150 pos_0.065_1
  says "thresholds alone"
  row "" "the same, to 0.065 Nm" "inertia not shown; $(figure 'running effort') Nm at full speed" "one step from rest"
fi

if there nolicence/lugre-servo-motor; then
  machine servo 1000 <<<$'[spindle]\nencoder_counts_per_rev = 10000'
  for name in J_1 J_2 J_3; do
    import "$data/nolicence/lugre-servo-motor/$name.f32" --out $name.trace --only --column spindle.angle_rad=pos:rad --column spindle.torque_Nm=torque_cmd:Nm
    learn servo $name
    inertia=$(figure inertia)
    within "inertia" "$inertia" 1.75e-4 2.1e-4
    found="${found:-}${found:+, }$inertia"
  done
  row lugre-servo-motor "inertia from torque swings, three records" "$found kg m2" "1.83e-4 to 1.97e-4 by least squares behind 20 Hz; 1.76e-4 published, which the files do not bear out"
  for name in sigma0_1 sigma0_2; do
    import "$data/nolicence/lugre-servo-motor/$name.f32" --out $name.trace --only --column spindle.angle_rad=pos:rad --column spindle.torque_Nm=torque_cmd:Nm
    "$program" identify presliding --quiet --machine servo.ini --trace $name.trace --out pushed.ini >said.txt
    within "slope" "$(figure 'slope of the loop')" 4.6 5.5
    slopes="${slopes:-}${slopes:+ and }$(figure 'slope of the loop') $(awk '/slope of the loop/ { print $6, $7 }' said.txt)"
  done
  row "" "stiffness before it breaks away, two records" "$slopes Nm/rad" "5.0 Nm/rad by least squares"
fi

if there nolicence/lugre-direct-drive; then
  machine arm 66.84 <<<$'[axis.a]'
  import "$data/nolicence/lugre-direct-drive/test1_est_j1_05_gan.csv" --out arm.trace --only --column a.angle_rad=pos_deg:deg --column a.torque_Nm=tau_Nm:Nm
  learn arm arm
  says "one way only"
  row lugre-direct-drive "friction from a slow ramp to breakaway" "moves one way only: $(figure 'running effort') Nm, friction or load" "breakaway at 10.75 and -12.00 Nm published"
fi

if there nolicence/saw-chatter-servo; then
  machine saw 10 <<<$'[axis.z]\nrated_torque_Nm = 1\nlead_m = 0.01\n[monitor.reference]\nreference = saw.reference'
  stable="1 2 4 5 6 7 9 10 11"
  for name in $stable A B D E F H; do
    import "$data/nolicence/saw-chatter-servo/cut_$name.csv" --out saw_$name.trace --only --column spindle.load_percent=motor_load_pct:% \
      --column z.position_m=head_pos_mm:mm --column z.torque_percent=head_torque_pct:% --column spindle.power_W=active_power_W:W
  done
  teach() { "$program" identify reference --quiet --machine saw.ini --out saw.reference "$@" >said.txt; }
  sound=0 chatter=0
  alarmed() { watch saw saw_$1 && says "runs: compares windows" && [ "$(verdict)" = alarm ]; }
  : >sound.txt; : >chatter.txt
  for name in $stable; do
    teach $(for other in $stable; do [ $other = $name ] || echo saw_$other.trace; done)
    alarmed $name && sound=$((sound + 1))
    distances saw saw_$name >>sound.txt
  done
  teach $(for name in $stable; do echo saw_$name.trace; done)
  # From which part of the cut on it chatters, as the publisher noted.
  for cut in A:0.45 B:0.095 D:0.22 E:0.31 F:0.39 H:0.38; do
    name=${cut%%:*}
    alarmed $name && chatter=$((chatter + 1))
    onset=$("$program" monitor --quiet --machine saw.ini --trace saw_$name.trace --json |
      awk -v share="${cut#*:}" -v RS='{' '/"from_s"/ && match($0, /"distance": [0-9.e+-]+/) {
        match($0, /"from_s": [0-9.e+-]+/); t = substr($0, RSTART + 10, RLENGTH - 10); if (first == "") first = t; last = t }
        END { print first + share * (last - first) }')
    distances saw saw_$name "$onset" >>chatter.txt
  done
  within "false alarms" $sound 0 1
  row saw-chatter-servo "alarms, each sound cut by the eight others" "in $chatter of 6 that chatter and $sound of 9 that do not" "chatter is beyond what 10 Hz show"
  seen=$(area chatter.txt sound.txt)
  better_than_chance "saw" "$seen"
  row "" "windows that chatter farther than sound ones" "$seen of the pairs" "half would be chance; their speeds and feeds differ, too"
fi

if there nolicence/ur10e-friction-collision; then
  machine ur10e 94.66 <<<$'[axis.a]\ntorque_constant_Nm_per_A = 1\ncurrent_is_ratio = yes'
  for name in joint_1 push_pose_1; do
    import "$data/nolicence/ur10e-friction-collision/ur-20_01_22-$name.f32" --out $name.trace --only --column t_s=t_s:s --column a.angle_rad=q_rad_1:rad --column a.current_A=i_A_1:A
  done
  learn ur10e joint_1
  says "does not show the inertia"
  row ur10e-friction-collision "inertia and friction of joint 1" "inertia not shown; running current $(figure 'running effort') A" "at 100 Hz the moves hold no acceleration"
  watch ur10e_learned push_pose_1
  says "slow signal"
  row "" "pushes by hand, standing arm" "not watched: needs 500 Hz" "pushes there are, with no times; brought to 1 kHz four of four are found"
fi

if there nolicence/tool-edge-damage-currents; then
  machine mill 500 <<<$'[spindle]\nconstant_speed_rpm = 2000\ntorque_constant_Nm_per_A = 1\ncurrent_is_ratio = yes\n[monitor.reference]\nreference = mill.reference'
  edges() {  # RECORD: as a trace
    import "$data/nolicence/tool-edge-damage-currents/$1.f32" --out $1.trace --rate 500 --only --column x.current_A=current_x:A \
      --column y.current_A=current_y:A --column spindle.current_A=current_s:A
  }
  for name in normal 1edge 2edges 3edges; do
    edges d12_$name
    [ $name != normal ] || "$program" identify reference --quiet --machine mill.ini --out mill.reference d12_normal.trace >said.txt
    watch mill d12_$name
    says "runs: compares windows"
    answer="${answer:-}${answer:+, }$(grep -c ' alarm    reference ' said.txt || true)"
  done
  row tool-edge-damage-currents "12 mm mills against the sound one" "alarms with 0, 1, 2 and 3 broken edges: $answer" "0, 1, 2 and 3 edges are broken; rate and speed are assumptions"
  within "alarms with no edge broken" "${answer%%,*}" 0 0
  # What teaches is not judged: the first 75 s of the sound record against the rest of it, and the damaged ones.
  pairs=()
  for tool in d12 d16; do
    edges ${tool}_normal
    awk -F, '/^[#t]/ || $1 < 75' ${tool}_normal.trace >begin.trace
    awk -F, '/^[#t]/ || $1 >= 75' ${tool}_normal.trace >end.trace
    "$program" identify reference --quiet --machine mill.ini --out mill.reference begin.trace >said.txt
    distances mill end >${tool}_sound.txt
    : >${tool}_damaged.txt
    for name in 1edge 2edges 3edges; do
      [ -e "$data/nolicence/tool-edge-damage-currents/${tool}_$name.f32" ] || continue
      edges ${tool}_$name
      distances mill ${tool}_$name >one.txt
      cat one.txt >>${tool}_damaged.txt
      row "" "${tool#d} mm, ${name%edge*} of 4 edges: windows farther than sound ones" "$(area one.txt ${tool}_sound.txt) of the pairs" "half would be chance"
    done
    pairs+=(${tool}_damaged.txt ${tool}_sound.txt)
  done
  seen=$(area "${pairs[@]}")
  better_than_chance "tool edges" "$seen"
  row "" "all of them, mean of both tools" "$seen of the pairs" "likewise; one sound record a tool"
fi

if there nolicence/mill-vibration-hurco; then
  machine hurco 8000 <<<$'[spindle]\nconstant_speed_rpm = 6000\nload_percent_of = torque\nrated_torque_Nm = 1'
  import "$data/nolicence/mill-vibration-hurco/PCB_6000RPM_AirCut.f32" --out hurco.trace --only --column spindle.load_percent=load_s:%
  learn hurco hurco
  says "the effort never changes (0 throughout)"
  row mill-vibration-hurco "inertia and friction from the load in percent" "refused: the effort never changes" "the control shows 0 % throughout, in the air; the other records have no signal of a drive"
fi

[ $done -gt 0 ] || exit 77
exit $failed
