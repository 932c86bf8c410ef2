component servosense "Cutting force and torque from the drives, with alarms for chatter and collision.";

description """
Estimates cutting torque and force from the position and motor current (or torque command) of the drives, and watches
them: chatter on the spindle, collision on the axes, tooth breakage. Put it in the servo thread behind the component
that reads the drives. Positions are in user units of the machine; *unit_m* says how many metres one is.

At 8 kHz (period 125000) all monitors run. In the usual servo thread of 1 kHz, chatter is seen up to 500 Hz and a
collision within some 5 ms.

*config* names a machine file of servosense, *period_ns* the period of the thread in nanoseconds (1000000 by default).
.nf
  loadrt servosense config=/home/cnc/mill.ini period_ns=1000000
  addf servosense servo-thread
.fi
""";

pin in float spindle-revs "turned so far [revolutions], as motion's spindle.N.revs";
pin in float spindle-current "motor current of the spindle [A]";
pin in float axis-#-pos[6] "position of x, y, z in user units, of a, b, c in degrees";
pin in float axis-#-current[6] "motor current of x, y, z, a, b, c [A]";
pin in signed nc-block = -1 "line of the program, as motion.program-line; -1 where it is not wired";
pin in float feed-override = 1 "of the programmed feed; heard with nc-block";
pin in bit program-start "its rising edge: the program of the torque band begins here";
pin in bit enable = true "while false, the estimates are 0 and nothing alarms";

pin out float spindle-torque "estimated cutting torque [Nm]";
pin out float axis-#-force[6] "estimated cutting force [N], of a, b, c torque [Nm]";
pin out bit chatter "chatter alarm";
pin out float chatter-level "power off the harmonics of the spindle, as a part of its threshold";
pin out bit collision "collision alarm of any axis";
pin out bit axis-#-collision[6];
pin out bit breakage "tooth breakage alarm";
pin out bit drill-fracture "drill fracture alarm";
pin out bit wear "wear alarm";
pin out bit torque-band "the torque has left its band";
pin out bit signal-fault "some signal cannot be trusted";
pin out bit alarm "any of them, as long as it lasts";
pin out bit feed-hold "from an alarm until *resume*; for motion.feed-hold";
pin in bit resume "its rising edge ends feed-hold; an alarm that still stands does not begin it again";
pin out u32 alarms "raised since the start";

param rw float unit-m = 0.001 "metres in a user unit";

function _ fp;
option singleton yes;
option extra_setup yes;
option extra_cleanup no;
license "MIT";
author "The servosense project";
include "servosense/capi/machine_file.h";
;;

static char* config = "";
RTAPI_MP_STRING(config, "machine file");
static int period_ns = 1000000;
RTAPI_MP_INT(period_ns, "period of the thread [ns]");
static int spindle = 1;
RTAPI_MP_INT(spindle, "1: the spindle reports");
static int axes = 7;
RTAPI_MP_INT(axes, "axes that report: 1 x, 2 y, 4 z, 8 a, 16 b, 32 c, added up");

static union {
  double align[2];
  unsigned char bytes[SERVOSENSE_STORAGE_BYTES];
} storage __attribute__((aligned(16)));
static servosense_stack* stack;
static servosense_config machine;
static int told;
static int resumed;
static int begun;
static long long now_ns;
static int states[SERVOSENSE_SIGNAL + 1][1 + SERVOSENSE_AXES];

EXTRA_SETUP() {
  char error[400];
  const char* parameter;
  const char* fault;
  servosense_signals signals;
  int i;
  (void)prefix;
  (void)extra_arg;
  signals.sample_period_s = 1e-9 * period_ns;
  signals.motion[0] = spindle ? SERVOSENSE_POSITION : -1;
  signals.current[0] = 1;
  for (i = 0; i < SERVOSENSE_AXES; ++i) {
    signals.motion[1 + i] = axes >> i & 1 ? SERVOSENSE_POSITION : -1;
    signals.current[1 + i] = 1;
  }
  if (servosense_config_from_file(config, &signals, &machine, error, sizeof error) != 0) {
    rtapi_print_msg(RTAPI_MSG_ERR, "servosense: %s\n", error);
    return -EINVAL;
  }
  fault = servosense_init(storage.bytes, sizeof storage.bytes, &machine, &stack, &parameter);
  if (fault) {
    rtapi_print_msg(RTAPI_MSG_ERR, "servosense: %s: %s\n", parameter, fault);
    return -EINVAL;
  }
  return 0;
}

FUNCTION(_) {
  /* halcompile makes macros of pins, which are members of the sample by name, too. */
  const int32_t block = nc_block;
  const double override = feed_override;
#undef nc_block
#undef feed_override
  servosense_sample sample;
  servosense_event events[SERVOSENSE_MAX_EVENTS];
  int i, n, monitor, channel;
  /* Everything was worked out for period_ns: at another one the estimates would be wrong. */
  if (period < period_ns - period_ns / 50 || period > period_ns + period_ns / 50) {
    if (!told++)
      rtapi_print_msg(RTAPI_MSG_ERR, "servosense: the thread's period is %ld ns; load with period_ns=%ld\n",
                      period, period);
    signal_fault = 1;
    return;
  }
  memset(&sample, 0, sizeof sample);
  now_ns += period;
  sample.t_ns = now_ns;
  sample.spindle.motion = 6.283185307179586 * spindle_revs;
  sample.spindle.effort = (float)spindle_current;
  for (i = 0; i < SERVOSENSE_AXES; ++i) {
    sample.axis[i].motion = (i < 3 ? unit_m : 0.017453292519943295) * axis_pos(i);
    sample.axis[i].effort = (float)axis_current(i);
  }
  if (!enable) {
    sample.spindle.motion_flags = sample.spindle.effort_flags = SERVOSENSE_MISSING;
    for (i = 0; i < SERVOSENSE_AXES; ++i)
      sample.axis[i].motion_flags = sample.axis[i].effort_flags = SERVOSENSE_MISSING;
  }
  sample.tells_program = block >= 0;
  sample.nc_block = block;
  sample.feed_override = override;
  if (program_start && !begun) servosense_start_program(stack, 0);
  begun = program_start;
  n = servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
  for (i = 0; i < n; ++i) {
    channel = events[i].channel <= SERVOSENSE_AXES ? events[i].channel : 0;
    states[events[i].monitor][channel] = events[i].state;
    if (events[i].state == SERVOSENSE_ALARM) ++alarms;
    if (events[i].monitor == SERVOSENSE_CHATTER && events[i].threshold > 0)
      chatter_level = events[i].value / events[i].threshold;
  }
  if (n > 0) {
    chatter = states[SERVOSENSE_CHATTER][0] == SERVOSENSE_ALARM;
    breakage = states[SERVOSENSE_TOOTH_BREAKAGE][0] == SERVOSENSE_ALARM ||
               states[SERVOSENSE_AR_BREAKAGE][0] == SERVOSENSE_ALARM;
    collision = signal_fault = 0;
    for (i = 0; i <= SERVOSENSE_AXES; ++i) {
      if (i > 0) {
        axis_collision(i - 1) = states[SERVOSENSE_COLLISION][i] == SERVOSENSE_ALARM;
        if (axis_collision(i - 1)) collision = 1;
      }
      for (monitor = 0; monitor <= SERVOSENSE_SIGNAL; ++monitor)
        if (states[monitor][i] == SERVOSENSE_SIGNAL_FAULT) signal_fault = 1;
    }
    drill_fracture = states[SERVOSENSE_DRILL_FRACTURE][0] == SERVOSENSE_ALARM;
    wear = states[SERVOSENSE_WEAR][0] == SERVOSENSE_ALARM;
    torque_band = states[SERVOSENSE_TORQUE_BAND][0] == SERVOSENSE_ALARM;
    alarm = chatter || collision || breakage || drill_fracture || wear || torque_band;
  }
  /* A hold that ended with its alarm would let the machine start by itself. */
  if (resume && !resumed) servosense_release_stop(stack);
  resumed = resume;
  feed_hold = servosense_stop_requested(stack);
  spindle_torque = enable && machine.spindle.present ? servosense_estimate(stack, SERVOSENSE_SPINDLE) : 0;
  for (i = 0; i < SERVOSENSE_AXES; ++i)
    axis_force(i) = enable && machine.axis[i].present ? servosense_estimate(stack, 1 + i) : 0;
}
