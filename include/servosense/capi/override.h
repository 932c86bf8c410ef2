/* servosense for C: overrides from alarms (docs/closed-loop.md), in storage that the caller owns.
 *
 *   servosense_override_config config;
 *   servosense_override_default_config(&config);
 *   config.least_speed = 0.7;                 ... what may be commanded
 *   fault = servosense_override_init(&storage, &config, &parameter);
 *   each servo period: command = servosense_override_process(&storage, &input);
 *
 * Ratios are to the program. Nothing is allowed unless it is set: by default both stay at 1, and
 * alarms hold the feed. Which alarms stand, servosense_process() tells. Not a safety function.
 */
#ifndef SERVOSENSE_CAPI_OVERRIDE_H
#define SERVOSENSE_CAPI_OVERRIDE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  double sample_period_s;
  double least_speed, greatest_speed; /* at most 1; at least 1 */
  double least_feed, greatest_feed;
  double speed_rate_per_s;    /* greatest change of the speed ratio */
  double feed_rate_per_s;     /* and of the feed ratio */
  double variation_amplitude; /* of the sinusoidal speed variation; 0: none */
  double variation_hz;
  double patience_s;   /* for a step to end the alarm, once it is there */
  double return_s;     /* after alarm or cut, before the programmed values come back */
  double load_release; /* load below which the feed comes back */
  int feed_per_minute; /* 1: the feed does not follow the spindle by itself (G94) */
} servosense_override_config;

typedef struct {
  int chatter;   /* its alarm stands */
  int collision; /* its alarm stands */
  int in_cut;    /* as far as is known: 1 if not */
  float load;    /* over what it may be, low-passed at 25 rad/s; NaN: not known */
  /* Speed ratios to try, the best first; NaN or 0: none. To be kept until the cut ends. */
  float advised[2];
  int advice_pending; /* it is being looked for: nothing is given up meanwhile */
  int resume;         /* its rising edge: the operator lets the feed go on */
  int taken_over;     /* the operator has moved an override */
} servosense_override_input;

enum {
  SERVOSENSE_PROGRAMMED, /* as the program says, or on the way back to it */
  SERVOSENSE_ADVISED,    /* to or at an advised speed */
  SERVOSENSE_VARYING,    /* sinusoidal speed variation */
  SERVOSENSE_REDUCED,    /* nothing is left to try: least feed */
  SERVOSENSE_YIELDED     /* the operator has moved an override: nothing is commanded */
};

typedef struct {
  float speed_ratio;
  float feed_ratio;
  int hold; /* 1: hold the feed, until resume */
  int phase;
  int exhausted;  /* no stable speed is known inside the limits; until the cut ends */
  int overloaded; /* the load has brought the feed down */
} servosense_override_command;

/* All of its memory; what is inside is the library's. */
typedef struct {
  uint64_t made;
  uint64_t inside[28];
} servosense_override;

/* 8 kHz, both ratios 1, 0.5 a second, all else as the block's own defaults. */
void servosense_override_default_config(servosense_override_config* config);
/* NULL when all is well; else a sentence on what is wrong, and `*parameter` (may be NULL itself)
 * gets the field. Takes the C library's sine once: off the real-time path. */
const char* servosense_override_init(servosense_override* overrides,
                                     const servosense_override_config* config,
                                     const char** parameter);
/* As after servosense_override_init. */
void servosense_override_reset(servosense_override* overrides);
/* One servo period. What servosense_override_init did not make, and no input, hold the feed. */
servosense_override_command servosense_override_process(servosense_override* overrides,
                                                        const servosense_override_input* input);
const char* servosense_override_phase_name(int phase); /* "" for a number that is none */

#ifdef __cplusplus
}
#endif
#endif
