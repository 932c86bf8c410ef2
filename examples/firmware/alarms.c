/* A drive's firmware with the monitor stack in its servo interrupt. Runs on a Cortex-M7 under QEMU:
 *
 *   cmake --preset firmware-m7 && cmake --build --preset firmware-m7
 *   qemu-system-arm -M mps2-an500 -display none -semihosting \
 *     -kernel build/firmware-m7/bench/firmware/alarms.elf
 *
 * In place of current sensor and encoder stand two seconds of a made-up cut: from 1 s on the
 * spindle chatters, at 2 s the x axis runs into something. Alarms, and what the control is told for
 * them (another spindle speed, a feed hold), go to the debugger's console; on a computer, where the
 * same file compiles, to the terminal. bench/firmware/check.sh holds the one against the other.
 */
#include <stdint.h>
#include <string.h>

#include "servosense/capi/override.h"
#include "servosense/capi/servosense.h"

/* ---- the board ------------------------------------------------------------------------------ */

#ifdef __arm__
static void print(const char* text) { /* Arm semihosting, SYS_WRITE0 */
  register uint32_t operation __asm__("r0") = 0x04;
  register const char* parameter __asm__("r1") = text;
  __asm__ volatile("bkpt 0xAB" : "+r"(operation) : "r"(parameter) : "memory");
}
#else
#include <stdio.h>
static void print(const char* text) { fputs(text, stdout); }
#endif

static void print_number(uint32_t value) {
  char text[12];
  char* at = text + sizeof text - 1;
  *at = '\0';
  do {
    *--at = (char)('0' + value % 10);
    value /= 10;
  } while (value > 0);
  print(at);
}

/* A sine from a rotating pair, so that no mathematics library is needed. */
static float vibration(void) {
  static float c = 1.0F, s = 0.0F;
  const float cos_step = 0.8219286F, sin_step = 0.5695874F; /* 771.3 Hz at 8 kHz */
  const float next = c * cos_step - s * sin_step;
  s = s * cos_step + c * sin_step;
  c = next;
  return s;
}

/* ---- the servo loop ------------------------------------------------------------------------- */

static union {
  uint64_t align;
  unsigned char bytes[SERVOSENSE_STORAGE_BYTES];
} storage __attribute__((aligned(16)));
static servosense_stack* stack;
static servosense_override overrides;
static servosense_override_input heard;
static int alarms;

static void say(uint32_t n, const char* text) {
  print_number(n / 8);
  print(" ms: ");
  print(text);
}

/* What a control would be told, where it changes. */
static void command_overrides(uint32_t n) {
  static int phase = SERVOSENSE_PROGRAMMED, hold = 0;
  const servosense_override_command command = servosense_override_process(&overrides, &heard);
  if (command.phase != phase) {
    say(n, servosense_override_phase_name(command.phase));
    print(" spindle speed\n");
  }
  if (command.hold && !hold) say(n, "feed hold\n");
  phase = command.phase;
  hold = command.hold;
}

/* What the interrupt of the servo timer does, 8000 times a second. */
static void servo_interrupt(uint32_t n) {
  servosense_sample sample;
  servosense_event events[SERVOSENSE_MAX_EVENTS];
  const float shake = vibration();
  int count;
  int i;
  memset(&sample, 0, sizeof sample);
  sample.t_ns = (int64_t)n * 125000;
  sample.spindle.counts = (int64_t)n * 13107; /* 6000 rpm on 20 bits */
  sample.spindle.effort = 0.8F + (n > 8000 ? 16.0F * shake : 0.0F);
  sample.axis[0].counts = (int64_t)n * 2458; /* a rapid of 300 mm/s on 20 bits and 16 mm */
  sample.axis[0].effort = 94.0F + 219.6F + (n > 16000 ? 0.5F * (float)(n - 16000) * 100.0F : 0.0F);
  count = servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
  for (i = 0; i < count; ++i) {
    const int alarm = events[i].state == SERVOSENSE_ALARM;
    if (events[i].monitor == SERVOSENSE_CHATTER) heard.chatter = alarm;
    if (events[i].monitor == SERVOSENSE_COLLISION) heard.collision = alarm;
    if (!alarm) continue;
    ++alarms;
    say(n, servosense_monitor_name(events[i].monitor));
    print(" on ");
    print(servosense_channel_name(events[i].channel));
    print("\n");
  }
  command_overrides(n);
}

int main(void) {
  servosense_config config;
  servosense_override_config allowed;
  const char* parameter;
  const char* fault;
  uint32_t n;
  servosense_default_config(&config);
  config.spindle.present = 1;
  config.spindle.counts_per_turn = 1048576;
  config.spindle.effort_per_ampere = 0.5;
  config.spindle.inertia = 0.0048;
  config.chatter.chatter_threshold_Nm2 = 2;
  config.axis[0].present = 1;
  config.axis[0].counts_per_turn = 1048576;
  config.axis[0].unit_per_turn = 0.016;
  config.axis[0].inertia = 227;
  config.axis[0].viscous_friction = 732;
  config.axis[0].coulomb_friction = 94;
  config.collision[0].threshold_N_per_s = 14580;
  fault = servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter);
  if (fault != NULL) {
    print(parameter);
    print(": ");
    print(fault);
    print("\n");
    return 1;
  }
  servosense_override_default_config(&allowed);
  allowed.least_speed = 0.8;
  allowed.greatest_speed = 1.2;
  allowed.least_feed = 0.8;
  fault = servosense_override_init(&overrides, &allowed, &parameter);
  if (fault != NULL) {
    print(fault);
    print("\n");
    return 1;
  }
  heard.in_cut = 1;
  heard.load = 0.5F;
  heard.advised[0] = 1.08F; /* from the stability lobes of the tool; 0: none */
  for (n = 0; n < 18000; ++n) servo_interrupt(n);
  print_number((uint32_t)servosense_size());
  print(" bytes of storage in use\n");
  return alarms == 2 ? 0 : 1;
}
