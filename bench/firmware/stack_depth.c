/* Bytes of stack that the C interface takes on a Cortex-M with every monitor on and effects on a
 * drive: the stack below is painted, and what has lost its paint was used. Status 1 when more than
 * a controller should spare. */
#include <stdint.h>
#include <string.h>

#include "servosense/capi/servosense.h"

enum { PAINTED = 32768, INIT_LIMIT = 4096, PROCESS_LIMIT = 1024 };

static void print(const char* text) { /* Arm semihosting, SYS_WRITE0 */
  register uint32_t operation __asm__("r0") = 0x04;
  register const char* parameter __asm__("r1") = text;
  __asm__ volatile("bkpt 0xAB" : "+r"(operation) : "r"(parameter) : "memory");
}

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

static union {
  uint64_t align;
  unsigned char bytes[SERVOSENSE_STORAGE_BYTES];
} storage __attribute__((aligned(16)));

static uint32_t stack_pointer(void) {
  uint32_t at;
  __asm__ volatile("mov %0, sp" : "=r"(at));
  return at;
}

/* From here down everything is free, but for what this function itself takes. */
static __attribute__((noinline)) void paint(uint32_t from) {
  volatile uint32_t* at = (volatile uint32_t*)(uintptr_t)(from - PAINTED);
  const uint32_t end = stack_pointer() - 64;
  while ((uintptr_t)at < end) *at++ = 0xA5A5A5A5U;
}

static __attribute__((noinline)) uint32_t used(uint32_t from) {
  const volatile uint32_t* at = (const volatile uint32_t*)(uintptr_t)(from - PAINTED);
  while (*at == 0xA5A5A5A5U) ++at;
  return from - (uint32_t)(uintptr_t)at;
}

static const servosense_band_point reference[] = {{1, 0, 2, 0}, {1, 0, 2, 0}, {1, 0, 2, 0}};
static servosense_effect effects[2];
static servosense_config config;

static void everything(void) {
  int i;
  servosense_default_config(&config);
  effects[0].effect = (size_t)servosense_effect_number("stribeck-friction");
  effects[0].parameters[0].value[0] = 20;
  effects[0].parameters[1].value[0] = 0.002;
  effects[1].effect = (size_t)servosense_effect_number("torque-ripple");
  effects[1].parameters[0].value[0] = 6;
  effects[1].parameters[1].value[0] = 10;
  for (i = 0; i < 3; ++i) effects[1].parameters[i].count = 1;
  effects[0].parameters[0].count = effects[0].parameters[1].count = 1;
  config.spindle.present = 1;
  config.spindle.counts_per_turn = 1048576;
  config.spindle.inertia = 0.0048;
  config.chatter.chatter_threshold_Nm2 = 2;
  for (i = 0; i < SERVOSENSE_AXES; ++i) {
    config.axis[i].present = 1;
    config.axis[i].counts_per_turn = 1048576;
    config.axis[i].unit_per_turn = 0.016;
    config.axis[i].inertia = 227;
    config.axis[i].coulomb_friction = 94;
    config.axis[i].effects = effects;
    config.axis[i].effect_count = 2;
    config.collision[i].threshold_N_per_s = 14580;
  }
  config.teeth = 4;
  config.ar_breakage.enabled = config.tooth_breakage.enabled = config.drill_fracture.enabled = 1;
  config.wear.enabled = config.torque_band.enabled = 1;
  config.ar_breakage.noise_Nm = config.tooth_breakage.noise = 0.02;
  config.tooth_breakage.sample_noise = 0.05;
  config.drill_fracture.threshold_N = 40;
  config.wear.cutting_thrust_N = 120;
  config.wear.thrust_limit_N = 800;
  config.torque_band.reference = reference;
  config.torque_band.reference_count = 3;
  config.torque_band.spacing = config.torque_band.step = config.torque_band.shift_step = 0.1;
  config.torque_band.max_shift = 1;
  config.half_rate = 1;
  config.grouped = 1;
}

int main(void) {
  static servosense_event events[SERVOSENSE_MAX_EVENTS];
  static servosense_sample sample;
  servosense_stack* stack;
  const char* parameter;
  const char* fault;
  uint32_t from, of_init, of_process;
  int n;
  everything();
  from = stack_pointer();
  paint(from);
  fault = servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter);
  of_init = used(from);
  if (fault != NULL) {
    print(parameter);
    print(": ");
    print(fault);
    print("\n");
    return 1;
  }
  paint(from);
  for (n = 0; n < 16000; ++n) {
    sample.t_ns += 125000;
    sample.spindle.counts = n * 6000;
    sample.spindle.effort = n % 20 < 10 ? 5.0F : 0.1F;
    sample.axis[0].counts = n * 100;
    sample.axis[0].effort = n < 12000 ? 94.0F : 4000.0F;
    sample.axis[2].motion_flags = n > 8000 && n < 8100 ? SERVOSENSE_MISSING : SERVOSENSE_GOOD;
    servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
  }
  of_process = used(from);
  print("stack of servosense_init ");
  print_number(of_init);
  print(" bytes, of servosense_process ");
  print_number(of_process);
  print(" bytes; storage ");
  print_number((uint32_t)servosense_size());
  print(" bytes\n");
  return of_init < INIT_LIMIT && of_process < PROCESS_LIMIT ? 0 : 1;
}
