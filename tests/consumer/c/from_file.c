/* The same from the file itself: both ways give the same configuration. */
#include <stdio.h>
#include <string.h>

#include "machine.h"
#include "servosense/capi/machine_file.h"

/* Constants and what a file gave differ in where things lie, and in nothing else. */
static servosense_config without_addresses(servosense_config config) {
  int i;
  config.spindle.effects = NULL;
  for (i = 0; i < SERVOSENSE_AXES; ++i) config.axis[i].effects = NULL;
  config.torque_band.reference = NULL;
  config.torque_band.sections = NULL;
  return config;
}

#define SAME(part) (memcmp(&a.part, &b.part, sizeof a.part) == 0)

int main(int argc, char** argv) {
  const servosense_signals signals = {
      1 / 8000.0,
      {SERVOSENSE_COUNTS, SERVOSENSE_COUNTS, -1, -1},
      {1, 1, 1, 1},
  };
  static servosense_config config, a, b;
  char error[400];
  int i;
  if (argc != 2) return 2;
  if (servosense_config_from_file(argv[1], &signals, &config, error, sizeof error) != 0) {
    printf("%s\n", error);
    return 1;
  }
  a = without_addresses(config);
  b = without_addresses(machine);
  if (!SAME(chatter.chatter_threshold_Nm2) || !SAME(chatter.window_revolutions) ||
      !SAME(collision[0].threshold_N_per_s) || !SAME(collision[0].notch_hz) ||
      !SAME(cut.torque_Nm) || !SAME(teeth) || !SAME(spindle.inertia) ||
      !SAME(spindle.counts_per_turn) || !SAME(axis[0].effect_count) ||
      !SAME(axis[0].cutoff_rad_s) || !SAME(axis[0].present) || !SAME(axis[1].present) ||
      !SAME(ar_breakage.noise_Nm) || !SAME(half_rate) || !SAME(grouped)) {
    printf("header and file differ\n");
    return 1;
  }
  for (i = 0; i < (int)config.axis[0].effect_count; ++i)
    if (memcmp(&config.axis[0].effects[i], &machine.axis[0].effects[i],
               sizeof config.axis[0].effects[i]) != 0) {
      printf("effects differ\n");
      return 1;
    }
  if (config.axis[0].effect_count != 1) return 1;
  servosense_free_config(&config);
  printf("%g\n", machine.axis[0].inertia);
  return 0;
}
