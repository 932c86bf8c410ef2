/* What the component must give for a stream: the C interface alone, on the same numbers.
 *   expected PERIOD_NS MACHINE <input >output
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "servosense/capi/machine_file.h"

static union {
  double align[2];
  unsigned char bytes[SERVOSENSE_STORAGE_BYTES];
} storage __attribute__((aligned(16)));

int main(int argc, char** argv) {
  servosense_signals signals;
  servosense_config config;
  servosense_stack* stack;
  servosense_sample sample;
  servosense_event events[SERVOSENSE_MAX_EVENTS];
  char error[400];
  double revs, spindle_current, position, current;
  int chatter = 0, collision = 0, hold = 0, resume, resumed = 0, n, i;
  long period;
  if (argc != 3) return 2;
  period = atol(argv[1]);
  for (i = 0; i <= SERVOSENSE_AXES; ++i) {
    signals.motion[i] = i <= SERVOSENSE_X ? SERVOSENSE_POSITION : -1;
    signals.current[i] = 1;
  }
  signals.sample_period_s = 1e-9 * (double)period;
  if (servosense_config_from_file(argv[2], &signals, &config, error, sizeof error) != 0 ||
      servosense_init(storage.bytes, sizeof storage.bytes, &config, &stack, NULL) != NULL) {
    fprintf(stderr, "%s\n", error);
    return 1;
  }
  memset(&sample, 0, sizeof sample);
  while (scanf("%lf %lf %lf %lf %d", &revs, &spindle_current, &position, &current, &resume) == 5) {
    sample.t_ns += period;
    sample.spindle.motion = 6.283185307179586 * revs;
    sample.spindle.effort = (float)spindle_current;
    sample.axis[0].motion = 0.001 * position;
    sample.axis[0].effort = (float)current;
    n = servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
    for (i = 0; i < n; ++i) {
      if (events[i].state == SERVOSENSE_ALARM) hold = 1;
      if (events[i].monitor == SERVOSENSE_CHATTER) chatter = events[i].state == SERVOSENSE_ALARM;
      if (events[i].monitor == SERVOSENSE_COLLISION)
        collision = events[i].state == SERVOSENSE_ALARM;
    }
    if (resume && !resumed) hold = 0;
    resumed = resume;
    printf("%f %f %d %d %d\n", servosense_estimate(stack, SERVOSENSE_SPINDLE),
           servosense_estimate(stack, SERVOSENSE_X), chatter, collision, hold);
  }
  return 0;
}
