/* servosense for C: the monitor stack, in storage that the caller owns.
 *
 * Single precision, as on a controller. No allocation, no exception, no global state: several
 * stacks may run side by side, each in one thread at a time. C99.
 *
 *   servosense_config config;
 *   servosense_default_config(&config);
 *   config.axis[0].present = 1;              ... what the machine is
 *   const char* fault = servosense_init(storage, sizeof storage, &config, &stack);
 *   if (fault != NULL) ...                   ... a sentence, and what it is about
 *   for (;;) n = servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
 *
 * Units are SI: rad and Nm for the spindle, m and N for the axes.
 */
#ifndef SERVOSENSE_CAPI_SERVOSENSE_H
#define SERVOSENSE_CAPI_SERVOSENSE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Rises by one with every change of a struct or a meaning below. */
#define SERVOSENSE_CAPI_VERSION 1
#define SERVOSENSE_AXES 3
#define SERVOSENSE_MAX_EVENTS 16
/* Enough for every stack of this version, 16-byte aligned; servosense_size() says exactly. */
#define SERVOSENSE_STORAGE_BYTES 131072

enum { SERVOSENSE_COUNTS, SERVOSENSE_POSITION, SERVOSENSE_VELOCITY };

enum {
  SERVOSENSE_CHATTER,
  SERVOSENSE_COLLISION,
  SERVOSENSE_DRILL_FRACTURE,
  SERVOSENSE_AR_BREAKAGE,
  SERVOSENSE_TOOTH_BREAKAGE,
  SERVOSENSE_WEAR,
  SERVOSENSE_TORQUE_BAND,
  SERVOSENSE_SIGNAL
};

enum {
  SERVOSENSE_IDLE,
  SERVOSENSE_LEARNING,
  SERVOSENSE_ARMED,
  SERVOSENSE_WARNING,
  SERVOSENSE_ALARM,
  SERVOSENSE_SIGNAL_FAULT
};

enum { SERVOSENSE_SPINDLE, SERVOSENSE_X, SERVOSENSE_Y, SERVOSENSE_Z, SERVOSENSE_TOOL = 7 };

/* In place of a threshold: this monitor is off on purpose. Zero is refused: it could not alarm. */
#define SERVOSENSE_OFF (-1.0)

/* What is known against a value; 0 is good. Flags may be or-ed. */
enum {
  SERVOSENSE_GOOD = 0,
  SERVOSENSE_HELD = 1,    /* no new value at this instant; legal */
  SERVOSENSE_INVALID = 2, /* NaN, or marked so by the drive */
  SERVOSENSE_MISSING = 4  /* it never arrived */
};

typedef struct {
  int present;                 /* 0: everything else is left alone */
  int motion;                  /* SERVOSENSE_COUNTS, _POSITION or _VELOCITY */
  double counts_per_turn;      /* of the encoder; counts only */
  uint32_t counter_bits;       /* 1 to 64; counts only */
  double unit_per_turn;        /* m of travel a turn; 2 pi for the spindle */
  double effort_per_ampere;    /* Nm/A or N/A; 1 when the effort is Nm or N already */
  double inertia;              /* kg m2, or kg at the stage */
  double viscous_friction;     /* Nm s/rad, or N s/m */
  double coulomb_friction;     /* Nm, or N */
  double constant_load;        /* weight that the motor carries, N */
  double cutoff_rad_s;         /* of the reported estimate */
  double monitor_cutoff_rad_s; /* of what chatter or collision listens to */
} servosense_drive;

typedef struct {
  uint32_t size; /* sizeof(servosense_config): set by servosense_default_config */
  double sample_period_s;
  servosense_drive spindle;
  servosense_drive axis[SERVOSENSE_AXES];
  uint32_t window_revolutions;                         /* of the chatter monitor, 2 to 8 */
  double chatter_threshold_Nm2;                        /* or SERVOSENSE_OFF; of a spindle that is present */
  double forced_threshold_Nm2;                         /* 0 or SERVOSENSE_OFF: no alarm */
  double collision_threshold_N_per_s[SERVOSENSE_AXES]; /* or SERVOSENSE_OFF; of those present */
  uint32_t teeth;                                      /* of the tool; 0 or 2 to 8 */
  double ar_noise_Nm;                                  /* learned; 0: monitor off */
  double tooth_noise_Nm;                               /* learned; 0: monitor off */
  double tooth_sample_noise_Nm;                        /* learned */
} servosense_config;

typedef struct {
  int64_t counts; /* SERVOSENSE_COUNTS */
  double motion;  /* position or velocity */
  float effort;   /* current [A], or torque or force */
  uint16_t motion_flags;
  uint16_t effort_flags;
} servosense_drive_sample;

typedef struct {
  int64_t t_ns;
  servosense_drive_sample spindle;
  servosense_drive_sample axis[SERVOSENSE_AXES];
} servosense_sample;

/* A monitor has changed its state. */
typedef struct {
  int monitor;
  int channel;
  int state;
  int before;
  float value;
  float threshold;
} servosense_event;

typedef struct servosense_stack servosense_stack;

/* SERVOSENSE_CAPI_VERSION of the library, to hold against that of the header. */
uint32_t servosense_version(void);
/* Bytes of storage that a stack takes, and what its address must be a multiple of. */
size_t servosense_size(void);
size_t servosense_alignment(void);

/* Nothing present, 8 kHz, cutoffs 335 (collision), 3500 (chatter) and 500 rad/s. */
void servosense_default_config(servosense_config* config);

/* Makes a stack in `storage`. NULL when all is well; else a sentence on what is wrong, and `*stack`
 * is NULL. `*parameter` (may be NULL itself) gets the name of the field, or "". */
const char* servosense_init(void* storage, size_t bytes, const servosense_config* config,
                            servosense_stack** stack, const char** parameter);
/* As after servosense_init. */
void servosense_reset(servosense_stack* stack);
/* One servo period. Writes up to `capacity` events and returns how many there were; there are never
 * more than SERVOSENSE_MAX_EVENTS. */
int servosense_process(servosense_stack* stack, const servosense_sample* sample,
                       servosense_event* events, int capacity);

/* A request to hold the feed: 1 from the sample in which an alarm was raised until
 * servosense_release_stop(). An alarm that still stands then is not raised anew: once an event.
 * Both may be called beside servosense_process(), from an interrupt or another thread. */
int servosense_stop_requested(const servosense_stack* stack);
void servosense_release_stop(servosense_stack* stack);

/* Cutting torque [Nm] or force [N] of a channel; NaN when it is not there. */
float servosense_estimate(const servosense_stack* stack, int channel);

/* Names as in the event stream; "" for a number that is none. */
const char* servosense_monitor_name(int monitor);
const char* servosense_state_name(int state);
const char* servosense_channel_name(int channel);

#ifdef __cplusplus
}
#endif
#endif
