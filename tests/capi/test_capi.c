/* The C interface from C: an axis that runs into something, a spindle that chatters, and what is
 * refused. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "servosense/capi/servosense.h"

static int checks = 0, failures = 0;
#define CHECK(expression)                                             \
  do {                                                                \
    ++checks;                                                         \
    if (!(expression)) {                                              \
      ++failures;                                                     \
      printf("%s:%d: failed: %s\n", __FILE__, __LINE__, #expression); \
    }                                                                 \
  } while (0)

static union {
  unsigned char bytes[SERVOSENSE_STORAGE_BYTES];
  double align[2];
  long double align_more;
} storage;

static servosense_config machine(void) {
  servosense_config config;
  servosense_default_config(&config);
  config.spindle.present = 1;
  config.spindle.counts_per_turn = 1048576;
  config.spindle.effort_per_ampere = 0.5;
  config.spindle.inertia = 0.0048;
  config.chatter_threshold_Nm2 = 2;
  config.axis[0].present = 1;
  config.axis[0].motion = SERVOSENSE_POSITION;
  config.axis[0].unit_per_turn = 0.016;
  config.axis[0].inertia = 227;
  config.axis[0].coulomb_friction = 94;
  config.collision_threshold_N_per_s[0] = 14580;
  return config;
}

static void alarms(void) {
  const double pi = 3.14159265358979;
  servosense_stack* stack = NULL;
  servosense_config config = machine();
  servosense_sample sample;
  servosense_event events[SERVOSENSE_MAX_EVENTS];
  double chatter_s = -1, collision_s = -1;
  int i, k, n, alarm, stops = 0;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) == NULL);
  if (stack == NULL) return;
  memset(&sample, 0, sizeof sample);
  CHECK(!servosense_stop_requested(stack));
  for (i = 0; i < 24000; ++i) {
    const double t = 125e-6 * i;
    const double vibration = t > 1 ? 8 * sin(2 * pi * 771.3 * t) : 0;
    const double contact = t > 2 ? fmin(4000, 4e5 * (t - 2)) : 0;
    sample.t_ns = (int64_t)i * 125000;
    sample.spindle.counts = (int64_t)(1048576 * 100 * t);
    sample.spindle.effort = (float)((0.4 + vibration) / 0.5);
    sample.axis[0].motion = 0.3 * t; /* a rapid: with the spindle turning, slower might be a cut */
    sample.axis[0].effort = (float)(94 + contact);
    n = servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
    CHECK(n >= 0 && n <= SERVOSENSE_MAX_EVENTS);
    for (alarm = k = 0; k < n; ++k) {
      if (events[k].state != SERVOSENSE_ALARM) continue;
      alarm = 1;
      if (events[k].monitor == SERVOSENSE_CHATTER && chatter_s < 0) chatter_s = t;
      if (events[k].monitor == SERVOSENSE_COLLISION && collision_s < 0) {
        collision_s = t;
        CHECK(events[k].channel == SERVOSENSE_X);
        CHECK(events[k].value > events[k].threshold);
        CHECK(fabs(events[k].threshold - 14580) < 1);
      }
    }
    /* In the very sample of the alarm, and not again for one that stands. */
    CHECK(servosense_stop_requested(stack) == alarm);
    stops += servosense_stop_requested(stack);
    servosense_release_stop(stack);
    if (i == 15000) CHECK(fabs(servosense_estimate(stack, SERVOSENSE_X)) < 2);
  }
  printf("  chatter from 1 s: %.4f s, contact at 2 s: %.4f s\n", chatter_s, collision_s);
  CHECK(chatter_s > 1 && chatter_s < 1.2);
  CHECK(collision_s > 2 && collision_s < 2.005);
  CHECK(stops >= 2 && stops < 20);
  CHECK(fabs(servosense_estimate(stack, SERVOSENSE_X) - 4000) < 40);
  CHECK(isnan(servosense_estimate(stack, SERVOSENSE_Y)));
  CHECK(isnan(servosense_estimate(stack, 99)));
  servosense_reset(stack);
  CHECK(servosense_estimate(stack, SERVOSENSE_X) == 0);
}

static void refused(void) {
  servosense_stack* stack = NULL;
  const char* parameter = NULL;
  servosense_config config = machine();
  CHECK(servosense_version() == SERVOSENSE_CAPI_VERSION);
  CHECK(servosense_size() <= SERVOSENSE_STORAGE_BYTES);
  CHECK(servosense_init(storage.bytes, servosense_size() - 1, &config, &stack, NULL) != NULL);
  CHECK(servosense_init(storage.bytes + 1, sizeof storage.bytes - 1, &config, &stack, NULL) !=
        NULL);
  CHECK(servosense_init(NULL, sizeof storage.bytes, &config, &stack, NULL) != NULL);
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, NULL, &stack, NULL) != NULL);
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, NULL, NULL) != NULL);
  config.size = 4;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "size") == 0 && stack == NULL);
  config = machine();
  config.axis[0].inertia = -1;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "inertia") == 0);
  config = machine();
  config.collision_threshold_N_per_s[0] = 0;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "threshold_N_per_s") == 0);
  config.collision_threshold_N_per_s[0] = SERVOSENSE_OFF;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) == NULL);
  servosense_default_config(&config);
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "present") == 0);
  config = machine();
  config.axis[0].motion = 7;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "motion") == 0);
  config = machine();
  config.sample_period_s = NAN;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(servosense_monitor_name(SERVOSENSE_TOOTH_BREAKAGE), "tooth-breakage") == 0);
  CHECK(strcmp(servosense_state_name(SERVOSENSE_SIGNAL_FAULT), "signal-fault") == 0);
  CHECK(strcmp(servosense_channel_name(SERVOSENSE_TOOL), "tool") == 0);
  CHECK(strcmp(servosense_monitor_name(-1), "") == 0 && strcmp(servosense_state_name(99), "") == 0);
}

int main(void) {
  alarms();
  refused();
  printf("%d checks, %d failed\n", checks, failures);
  return failures == 0 ? 0 : 1;
}
