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
  config.chatter.chatter_threshold_Nm2 = 2;
  config.axis[0].present = 1;
  config.axis[0].motion = SERVOSENSE_POSITION;
  config.axis[0].unit_per_turn = 0.016;
  config.axis[0].inertia = 227;
  config.axis[0].coulomb_friction = 94;
  config.collision[0].threshold_N_per_s = 14580;
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
  CHECK(strcmp(parameter, "axis[0].inertia") == 0);
  config = machine();
  config.collision[0].threshold_N_per_s = 0;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "collision[0].threshold_N_per_s") == 0);
  config.collision[0].enabled = 0;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) == NULL);
  servosense_default_config(&config);
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "present") == 0);
  config = machine();
  config.axis[0].motion = 7;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(parameter, "axis[0].motion") == 0);
  config = machine();
  config.sample_period_s = NAN;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, &parameter) != NULL);
  CHECK(strcmp(servosense_monitor_name(SERVOSENSE_TOOTH_BREAKAGE), "tooth-breakage") == 0);
  CHECK(strcmp(servosense_state_name(SERVOSENSE_SIGNAL_FAULT), "signal-fault") == 0);
  CHECK(strcmp(servosense_channel_name(SERVOSENSE_TOOL), "tool") == 0);
  CHECK(strcmp(servosense_monitor_name(-1), "") == 0 && strcmp(servosense_state_name(99), "") == 0);
}

/* The fault of a configuration with one field changed, and the field it is laid to. */
static const char* fault_of(const servosense_config* config, const char** parameter) {
  servosense_stack* stack = NULL;
  *parameter = "";
  return servosense_init(storage.bytes, sizeof storage.bytes, config, &stack, parameter);
}
#define REFUSED(field, value, path)                      \
  do {                                                   \
    servosense_config changed = machine();               \
    const char* where;                                   \
    changed.field = (value);                             \
    CHECK(fault_of(&changed, &where) != NULL);           \
    if (strcmp(where, path) != 0) printf("%s\n", where); \
    CHECK(strcmp(where, path) == 0);                     \
  } while (0)

/* Every fault names a field of this header, with its drive or monitor. */
static void named(void) {
  servosense_config config = machine();
  const char* where;
  servosense_effect effect;
  uint32_t r;
  REFUSED(spindle.inertia, 0, "spindle.inertia");
  REFUSED(axis[0].viscous_friction, -1, "axis[0].viscous_friction");
  REFUSED(axis[0].coulomb_friction, -1, "axis[0].coulomb_friction");
  REFUSED(axis[0].friction_knee, -1, "axis[0].friction_knee");
  REFUSED(axis[0].constant_load, NAN, "axis[0].constant_load");
  REFUSED(axis[0].load_inertia_share, 2, "axis[0].load_inertia_share");
  REFUSED(spindle.counts_per_turn, 0, "spindle.counts_per_turn");
  REFUSED(spindle.counter_bits, 70, "spindle.counter_bits");
  REFUSED(spindle.effort_per_ampere, 0, "spindle.effort_per_ampere");
  REFUSED(spindle.cutoff_rad_s, 0, "spindle.cutoff_rad_s");
  REFUSED(axis[0].cutoff_rad_s, 1e9, "axis[0].cutoff_rad_s");
  REFUSED(axis[0].monitor_cutoff_rad_s, 0, "axis[0].monitor_cutoff_rad_s");
  REFUSED(axis[0].velocity_cutoff_rad_s, 1e9, "axis[0].velocity_cutoff_rad_s");
  REFUSED(axis[0].signal.tolerated_share, -1, "axis[0].signal (tolerated_share)");
  REFUSED(axis[0].unit_per_turn, 16, "axis[0].unit_per_turn");
  REFUSED(sample_period_s, NAN, "sample_period_s");
  REFUSED(chatter.chatter_threshold_Nm2, 0, "chatter.chatter_threshold_Nm2");
  REFUSED(chatter.warning_fraction, 2, "chatter.warning_fraction");
  REFUSED(chatter.harmonics, 1000, "chatter.harmonics");
  REFUSED(cut.hold_s, -1, "cut.hold_s");
  REFUSED(collision[0].warning_fraction, 2, "collision[0].warning_fraction");
  REFUSED(ar_breakage.enabled, 1, "teeth");
  REFUSED(drill_fracture.enabled, 1, "drill_fracture.enabled");
  REFUSED(wear.enabled, 1, "wear.enabled");
  REFUSED(torque_band.enabled, 1, "torque_band.reference");
  REFUSED(axis[0].torque_constant_per_K, NAN, "axis[0].torque_constant_per_K");
  REFUSED(spindle.torque_constant_at_C, NAN, "spindle.torque_constant_at_C");
  REFUSED(axis[0].estimate_noise, -1, "axis[0].estimate_noise");
  REFUSED(friction.enabled, 1, "spindle.viscous_friction");
  config = machine();
  config.friction.enabled = 1;
  config.spindle.coulomb_friction = 0.1;
  CHECK(fault_of(&config, &where) != NULL && strcmp(where, "friction.cutting_torque_Nm") == 0);
  for (r = 0; r <= SERVOSENSE_MAX_REVOLUTIONS + 1; ++r) { /* as the header says */
    config = machine();
    config.chatter.window_revolutions = r;
    CHECK((fault_of(&config, &where) == NULL) == (r >= 3 && r <= SERVOSENSE_MAX_REVOLUTIONS));
  }
  memset(&effect, 0, sizeof effect);
  effect.effect = (size_t)servosense_effect_number("stribeck-friction");
  effect.parameters[0].value[0] = 20;
  effect.parameters[1].value[0] = 0.002;
  effect.parameters[0].count = effect.parameters[1].count = 1;
  config = machine();
  config.axis[0].effects = &effect;
  config.axis[0].effect_count = 1;
  CHECK(fault_of(&config, &where) == NULL);
  effect.parameters[1].value[0] = -1;
  CHECK(fault_of(&config, &where) != NULL);
  CHECK(strncmp(where, "axis[0].effects (", 17) == 0);
  CHECK(servosense_effect_number("no such effect") == -1);
}

/* Silence of a stack that was never made would look like no alarm. */
static void never_made(void) {
  servosense_sample sample;
  servosense_event event;
  servosense_config config = machine();
  servosense_stack* stack = NULL;
  memset(&sample, 0, sizeof sample);
  memset(storage.bytes, 0, sizeof storage.bytes);
  config.axis[0].inertia = -1;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) != NULL);
  CHECK(servosense_process(stack, &sample, &event, 1) == 1);
  CHECK(event.state == SERVOSENSE_SIGNAL_FAULT && event.channel == SERVOSENSE_MACHINE);
  CHECK(servosense_process((servosense_stack*)(void*)storage.bytes, &sample, &event, 1) == 1);
  CHECK(servosense_process(NULL, &sample, NULL, 0) == 1);
  CHECK(!servosense_stop_requested(NULL) && isnan(servosense_estimate(NULL, SERVOSENSE_X)));
  servosense_release_stop(NULL);
  servosense_reset(NULL);
}

/* A motor that is 50 K warmer gives 5 % less at the same current; nothing is told twice, nor what
 * is no temperature. */
static void temperature(void) {
  servosense_stack* stack = NULL;
  servosense_config config = machine();
  servosense_sample sample;
  servosense_event events[SERVOSENSE_MAX_EVENTS];
  const float told[] = {20, 70, NAN, INFINITY, 3000, 20};
  const double expected[] = {100, 95, 95, 95, 95, 100};
  int i, k;
  config.axis[0].torque_constant_per_K = -0.001;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) == NULL);
  if (stack == NULL) return;
  memset(&sample, 0, sizeof sample);
  sample.axis[0].effort = 100; /* at rest, and never moved: no friction is taken off */
  for (k = 0; k < 7; ++k) {
    if (k > 0) servosense_set_temperature(stack, SERVOSENSE_X, told[k - 1]);
    for (i = 0; i < 800; ++i) {
      sample.t_ns += 125000;
      servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
    }
    CHECK(fabs(servosense_estimate(stack, SERVOSENSE_X) - (k > 0 ? expected[k - 1] : 100)) < 1e-3);
  }
  servosense_set_temperature(stack, SERVOSENSE_Y, 70);
  servosense_set_temperature(stack, -1, 70);
  servosense_set_temperature(stack, 99, 70);
  servosense_set_temperature(NULL, SERVOSENSE_X, 70);
  CHECK(fabs(servosense_estimate(stack, SERVOSENSE_X) - 100) < 1e-3);
}

/* The band by the formula of docs/estimate-band.md, at rest and sliding. */
static void bands(int grouped) {
  servosense_stack* stack = NULL;
  servosense_config config = machine();
  servosense_sample sample;
  servosense_event events[SERVOSENSE_MAX_EVENTS];
  const double coulomb = 94, viscous = 400, noise = 3, speed = 0.1;
  const double always = 3 * noise + 0.1 * coulomb;
  const double at_rest = always + 0.5 * coulomb + coulomb;
  const double sliding =
      always + 0.1 * viscous * speed + 0.5 * coulomb / (1 + speed / 0.02 * (speed / 0.02));
  int i;
  config.axis[0].viscous_friction = viscous;
  config.axis[0].estimate_noise = noise;
  config.grouped = grouped;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) == NULL);
  if (stack == NULL) return;
  memset(&sample, 0, sizeof sample);
  for (i = 0; i < 16000; ++i) {
    if (i == 100) {
      CHECK(isnan(servosense_estimate_band(stack, SERVOSENSE_X)));
      servosense_use_bands(stack, 1);
    }
    sample.t_ns += 125000;
    sample.spindle.counts = (int64_t)i * 1000;
    if (i > 4000 && i <= 12000) sample.axis[0].motion += 125e-6 * speed;
    servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
    if (i == 4000) CHECK(fabs(servosense_estimate_band(stack, SERVOSENSE_X) / at_rest - 1) < 1e-4);
    if (i == 12000) CHECK(fabs(servosense_estimate_band(stack, SERVOSENSE_X) / sliding - 1) < 1e-3);
  }
  /* Friction may point the other way than the last motion has bent it to. */
  CHECK(fabs(servosense_estimate_band(stack, SERVOSENSE_X) / (at_rest + coulomb) - 1) < 1e-3);
  CHECK(isnan(servosense_estimate_band(stack, SERVOSENSE_Y)));
  CHECK(isnan(servosense_estimate_band(NULL, SERVOSENSE_X)));
  servosense_use_bands(stack, 0);
  CHECK(isnan(servosense_estimate_band(stack, SERVOSENSE_X)));
}

/* A cold spindle in the air has a third more friction than the file: it is followed, and a cut is
 * read as it is. */
static void warm_up(int grouped) {
  servosense_stack* stack = NULL;
  servosense_config config = machine();
  servosense_sample sample;
  servosense_event events[SERVOSENSE_MAX_EVENTS];
  const double speed = 200, stated = 0.12 + 8e-4 * speed, air = 1.33 * stated;
  double followed;
  float viscous = 0, coulomb = 0, before;
  int i;
  config.spindle.viscous_friction = 8e-4;
  config.spindle.coulomb_friction = 0.12;
  config.friction.enabled = 1;
  config.friction.cutting_torque_Nm = 0.8;
  config.grouped = grouped;
  CHECK(servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) == NULL);
  if (stack == NULL) return;
  CHECK(servosense_followed_friction(NULL, NULL, NULL) == 0);
  CHECK(servosense_followed_friction(stack, &viscous, &coulomb) == 1);
  CHECK(fabs(viscous - 8e-4) < 1e-9 && fabs(coulomb - 0.12) < 1e-6);
  memset(&sample, 0, sizeof sample);
  for (i = 0; i < 80000; ++i) {
    const double t = 125e-6 * i;
    sample.t_ns += 125000;
    sample.spindle.counts = (int64_t)(1048576 / 6.283185307179586 * speed * t);
    sample.spindle.effort = (float)((t < 9 ? air : air + 3) / 0.5);
    servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
  }
  CHECK(servosense_followed_friction(stack, &viscous, &coulomb) == 1);
  followed = (double)coulomb + (double)viscous * speed;
  /* Some 20 windows bring it all the way; these are nine. What is left is read as cut. */
  CHECK(followed > stated + 0.65 * (air - stated) && followed < 1.01 * air);
  before = coulomb;
  CHECK(fabs(servosense_estimate(stack, SERVOSENSE_SPINDLE) - (3 + air - followed)) < 0.005);
  servosense_reset(stack);
  CHECK(servosense_followed_friction(stack, NULL, &coulomb) == 1);
  CHECK(before > 0.121F && fabs(coulomb - 0.12) < 1e-6);
}

int main(void) {
  alarms();
  temperature();
  bands(0);
  bands(1);
  warm_up(0);
  warm_up(1);
  named();
  never_made();
  refused();
  printf("%d checks, %d failed\n", checks, failures);
  return failures == 0 ? 0 : 1;
}
