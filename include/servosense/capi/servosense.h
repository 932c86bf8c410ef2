/* servosense for C: the monitor stack, in storage that the caller owns.
 *
 * Single precision, as on a controller. No allocation, no exception, no global state: several
 * stacks may run side by side, each in one thread at a time. C99.
 *
 *   servosense_config config;
 *   servosense_default_config(&config);
 *   config.axis[0].present = 1;              ... what the machine is
 *   const char* fault = servosense_init(storage, sizeof storage, &config, &stack, &parameter);
 *   if (fault != NULL) ...                   ... a sentence, and the field it is about
 *   for (;;) n = servosense_process(stack, &sample, events, SERVOSENSE_MAX_EVENTS);
 *
 * 'servosense export --c MACHINE --out machine.h' writes a machine file, with all that was learned,
 * as a constant servosense_config for flash: nothing is parsed on the controller.
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
#define SERVOSENSE_CAPI_VERSION 6
#define SERVOSENSE_MAX_EVENTS 24
/* Room in a stack, as in the program's own: what the program runs, the controller runs. Where
 * memory is short, define less for the library and for what includes this (docs/real-time.md has
 * bytes). */
#ifndef SERVOSENSE_AXES
#define SERVOSENSE_AXES 6 /* x, y, z, and those that turn, a, b, c; 3 or more */
#endif
#ifndef SERVOSENSE_MAX_TEETH
#define SERVOSENSE_MAX_TEETH 16 /* of the breakage monitors; 2 or more */
#endif
#ifndef SERVOSENSE_MAX_REVOLUTIONS
#define SERVOSENSE_MAX_REVOLUTIONS 32 /* of chatter's window; 3 or more */
#endif
#ifndef SERVOSENSE_MAX_HARMONICS
#define SERVOSENSE_MAX_HARMONICS 40
#endif
#ifndef SERVOSENSE_KEPT_SAMPLES
#define SERVOSENSE_KEPT_SAMPLES 1024 /* that a chatter alarm is replayed from */
#endif
#define SERVOSENSE_MAX_EFFECTS 8 /* of a drive */
/* Enough for every stack of this version, 16-byte aligned; servosense_size() says exactly. */
#ifndef SERVOSENSE_STORAGE_BYTES
#define SERVOSENSE_STORAGE_BYTES (139264 + 9216 * SERVOSENSE_AXES)
#endif

enum { SERVOSENSE_COUNTS, SERVOSENSE_POSITION, SERVOSENSE_VELOCITY };

enum {
  SERVOSENSE_CHATTER,
  SERVOSENSE_COLLISION,
  SERVOSENSE_DRILL_FRACTURE,
  SERVOSENSE_AR_BREAKAGE,
  SERVOSENSE_TOOTH_BREAKAGE,
  SERVOSENSE_WEAR,
  SERVOSENSE_TORQUE_BAND,
  SERVOSENSE_REFERENCE, /* of the program alone: no stack has it */
  SERVOSENSE_CUTTING_COEFFICIENTS,
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

enum {
  SERVOSENSE_SPINDLE,
  SERVOSENSE_X,
  SERVOSENSE_Y,
  SERVOSENSE_Z,
  SERVOSENSE_A,
  SERVOSENSE_B,
  SERVOSENSE_C,
  SERVOSENSE_TOOL,
  SERVOSENSE_MACHINE = 10
};

/* What is known against a value; 0 is good. Flags may be or-ed. */
enum {
  SERVOSENSE_GOOD = 0,
  SERVOSENSE_HELD = 1,    /* no new value at this instant; legal */
  SERVOSENSE_INVALID = 2, /* NaN, or marked so by the drive */
  SERVOSENSE_MISSING = 4  /* it never arrived */
};

/* An effect of the drive model (docs/effects.md). Numbers and order of parameters are those of the
 * library; servosense export fills them in. */
typedef struct {
  size_t effect; /* servosense_effect_number("stribeck-friction") */
  struct {
    double value[16];
    size_t count;
  } parameters[4];
} servosense_effect;

/* Watches what the drive reports. Counts of samples are those for 8 kHz. */
typedef struct {
  int enabled;
  double effort_limit; /* Nm or N the drive can give; 0: not known */
  uint32_t saturated_samples;
  uint32_t frozen_samples; /* 0: off */
  double tolerated_share;  /* of faulty samples, 0 to 1 */
  uint32_t window_samples;
  uint32_t release_samples;
} servosense_signal;

/* Of the axes the first three go straight; those behind them turn: m, N and kg are then rad, Nm and
 * kg m2 at the table, here and in servosense_collision. */
typedef struct {
  int present;              /* 0: everything else is left alone */
  int motion;               /* SERVOSENSE_COUNTS, _POSITION or _VELOCITY */
  double counts_per_turn;   /* of the encoder; counts only */
  uint32_t counter_bits;    /* 1 to 64; counts only */
  double unit_per_turn;     /* m of travel a turn; of what turns it is 2 pi whatever stands here */
  double effort_per_ampere; /* Nm/A or N/A; 1 when the effort is Nm or N already */
  double effort_update_s;   /* between two new efforts; 0: not known, measured */
  double torque_constant_per_K; /* of effort_per_ampere, its change with the motor's temperature */
  double torque_constant_at_C;  /* where it is as stated; see servosense_set_temperature */
  double inertia;               /* kg m2, or kg at the stage */
  double viscous_friction;      /* Nm s/rad, or N s/m */
  double coulomb_friction;      /* Nm, or N */
  double constant_load;         /* weight that the motor carries, N */
  double friction_knee;         /* rad or m of travel over which friction reverses, halved */
  double load_inertia_share;    /* of the stage; matters behind play: 0.01 to 0.99 */
  double load_friction_share;   /* likewise, 0 to 1 */
  double cutoff_rad_s;          /* of the reported estimate */
  double velocity_cutoff_rad_s; /* of its velocity; 0: cutoff_rad_s */
  double monitor_cutoff_rad_s;  /* of what chatter or collision listens to */
  double tool_cutoff_rad_s;     /* of x and y, for drill fracture and tooth breakage on forces */
  double estimate_noise;        /* of the estimate in the air, Nm or N; for its band */
  const servosense_effect* effects; /* read by servosense_init alone */
  uint32_t effect_count;            /* 0 to SERVOSENSE_MAX_EFFECTS */
  servosense_signal signal;
} servosense_drive;

/* The friction of the spindle, followed as it warms up (docs/warm-up.md). */
typedef struct {
  int enabled;
  double share;             /* of each friction, by which it is followed: above 0, to 0.9 */
  double cutting_torque_Nm; /* that means cutting; a quarter of it may be taken for friction */
  double minimum_speed_rad_s;
  double window_s;
} servosense_friction;

/* Of the spindle. */
typedef struct {
  int enabled;                  /* 0: torque is estimated and nothing watched */
  double chatter_threshold_Nm2; /* learned; enabled, one of the two must be positive */
  double forced_threshold_Nm2;  /* 0: no alarm */
  uint32_t window_revolutions;  /* 3 to SERVOSENSE_MAX_REVOLUTIONS */
  uint32_t harmonics;           /* of the rotation that count as forced */
  uint32_t consecutive_revolutions;
  uint32_t release_revolutions;
  double minimum_speed_rad_s; /* slower than this it idles */
  double warning_fraction;
  double release_fraction;
  double tolerated_stand_ins;  /* part of the window that may be replaced samples */
  double tolerated_load_share; /* of the load's mean square: chatter so small is none */
  double cutting_torque_Nm;    /* mean of a revolution that means cutting; 0: not known */
  double line_threshold;       /* of the score of a line; 0: none is heard */
} servosense_chatter;

/* Of an axis. Its low-pass is the axis's monitor_cutoff_rad_s. */
typedef struct {
  int enabled;              /* 0: force is estimated and nothing watched */
  double threshold_N_per_s; /* learned; positive where enabled */
  double
      phase_threshold_N_per_s[4];   /* standstill, constant, accelerating, reversing; 0: as above */
  double cutting_threshold_N_per_s; /* while the tool cuts; 0: not taught, unarmed there */
  double mean_N_per_s;
  double accelerating_m_s2;
  double maximum_feed_m_s; /* of a cut; faster is a rapid */
  double wait_s;           /* for the torque of a first contact */
  double tool_radius_m;    /* of the cutting edge, axes across the spindle; 0: not known */
  double notch_hz[2];      /* 0: none */
  double notch_quality;
  double resonance_hz; /* of the stage while the motor is held; 0: none */
  double resonance_quality;
  double warning_fraction;
  double release_fraction;
  uint32_t consecutive_samples;
  uint32_t release_samples;
} servosense_collision;

/* Tells collision whether the tool cuts, from the spindle's torque. */
typedef struct {
  double torque_Nm; /* that means cutting, low-passed; 0: not known */
  double cutoff_rad_s;
  double minimum_speed_rad_s;
  double hold_s;
  int unseen;               /* 1: there is a spindle that does not report */
  double load_cutoff_rad_s; /* of the torque that forces are held against */
  double load_hold_s;
} servosense_cut;

typedef struct {
  int enabled;
  double noise_Nm; /* of the idling spindle, mean over a tooth period; learned */
  double minimum_speed_rad_s;
  uint32_t order_revolutions;
  double memory_revolutions;
  uint32_t residual_window;
  double residual_ratio;
  double repetition_limit;
  double steadiness_limit;
  double share_threshold; /* of the usual mean torque of a tooth */
  double warning_fraction;
  double release_fraction;
  uint32_t release_revolutions;
  uint32_t stages_per_sample;
} servosense_ar_breakage;

typedef struct {
  int enabled;
  int torque;          /* 1: watches the spindle's torque, 0: the forces of x and y */
  double noise;        /* Nm or N, idling, mean over a tooth period; learned */
  double sample_noise; /* the same of a sample; learned */
  double minimum_speed_rad_s;
  double tolerated_throw; /* part of the feed per tooth */
  double swept_angle_rad; /* of every cut when known; 0: estimated */
  double new_fraction;
  double noise_factor;
  double memory_s;
  double threshold;
  double warning_fraction;
  double release_fraction;
  uint32_t release_revolutions;
  uint32_t consecutive_revolutions;
} servosense_tooth_breakage;

typedef struct {
  int enabled;
  double threshold_N;
  double drilling_thrust_N; /* that means drilling; 0: whenever the spindle turns */
  uint32_t window_samples;  /* 8 to 512; at half_rate of two servo periods each */
  int counter_clockwise;    /* 1: a force that turns with the tool turns so in x and y */
  double minimum_speed_rad_s;
  double entry_s;
  double average_s;
  double warning_fraction;
  double release_fraction;
  uint32_t release_verdicts;
  uint32_t consecutive_verdicts;
  double tolerated_stand_ins;
} servosense_drill_fracture;

/* A rule at 0 is off. */
typedef struct {
  int enabled;
  double part_s;
  int feed_direction; /* of z into the workpiece: -1, 1, or 0 for both */
  double cutting_thrust_N;
  double cutting_torque_Nm;
  double release_fraction;
  double maximum_feed_m_s;
  double minimum_speed_rad_s;
  double steady_fraction;
  double equivalent_mass_kg;
  double inertia_kg_m2;
  double entry_m;
  double exit_m;
  double shortest_m;
  double clearance_m;
  double peck_window_s;
  double thrust_limit_N;
  double thrust_step_N;
  double thrust_ratio; /* of the taught thrust */
  double torque_limit_Nm;
  double torque_step_Nm;
  double torque_ratio;         /* of the taught torque */
  double specific_force_ratio; /* of the new tool's, in milling: needs the coefficients */
  double warning_fraction;
  uint32_t teach_holes;
  uint32_t average_holes;
  uint32_t confirm_holes;
  double friction_error_N;
  double friction_drift_N;
  double friction_noise_N;
  double rapid_m_s;
  double spindle_error_Nm;
  double spindle_drift_Nm;
  double spindle_noise_Nm;
  double top_speed_rad_s;
  double tolerated_stand_ins;
  /* Taught on another tool of its kind; all 0: the first teach_holes teach. */
  double taught_thrust_N;
  double taught_thrust_scatter_N;
  double taught_torque_Nm;
  double taught_torque_scatter_Nm;
} servosense_wear;

/* Averages of a cut per unit of its coefficients, at its depth, width and direction; what goes with
 * the chip, at a feed of 1 m per tooth (docs/cutting-on-line.md; model/average_cutting.hpp has the
 * integrals). All are proportional to the depth. x is along the feed, forces are on the tool. */
typedef struct {
  double torque_chip_m3;
  double torque_edge_m2;
  double x_tangential_chip_m2;
  double x_tangential_edge_m;
  double x_radial_chip_m2;
  double x_radial_edge_m;
  double y_tangential_chip_m2;
  double y_tangential_edge_m;
  double y_radial_chip_m2;
  double y_radial_edge_m;
} servosense_cut_shares;

/* What is known of a coefficient before anything is cut, and its standard error. */
typedef struct {
  double value;
  double error;
} servosense_told;

/* The cutting coefficients, followed while the spindle mills with x and y. The tool has `teeth` of
 * servosense_config. */
typedef struct {
  int enabled;
  double cutting_torque_Nm; /* mean of a revolution from which on the tool cuts */
  double radius_m;          /* of the tool */
  double least_feed_per_tooth_m;
  double most_feed_per_tooth_m; /* faster is a rapid */
  double minimum_speed_rad_s;
  double settle_s; /* in which filters of the torque have forgotten the air */
  double steady_feed;
  double steady_speed;
  servosense_cut_shares shares;    /* of the first cuts: servosense_set_cut() */
  servosense_told tangential;      /* K_tc, N/m2 */
  servosense_told tangential_edge; /* K_te, N/m */
  servosense_told radial;          /* K_rc, N/m2 */
  servosense_told radial_edge;     /* K_re, N/m */
  double feed_per_tooth_m;         /* usual */
  double chip_m; /* mean chip thickness at which the specific force is stated; 0: of that feed */
  double torque_friction_error_Nm;
  double force_friction_error_N[2];
  double friction_memory_s;
  double drift;
  double smallest_change;
  double false_change_slots;
  uint32_t teach_slots;
  double taught_N_per_m2; /* specific cutting force of a new tool; 0: the first slots teach */
} servosense_coefficients;

typedef struct {
  float torque_Nm; /* expected */
  float lower_Nm;
  float upper_Nm;
  float feed;            /* at which that is so, m/s over path; 0: not known */
} servosense_band_point; /* lower above upper: nothing is expected here */

/* A stretch of the program that begins where the controller or the spindle tells. */
typedef struct {
  uint32_t first;    /* point of the reference */
  int32_t block;     /* nc_block of the samples; -1: not known */
  float speed_rad_s; /* of the spindle, absolute; 0: not known */
  uint8_t has_air;
  uint8_t behind_gap; /* nobody heard how the program came here */
  float air_Nm;       /* level of the torque in the air */
} servosense_band_section;

typedef struct {
  int enabled;
  const servosense_band_point* reference; /* must outlive the stack */
  uint32_t reference_count;
  const servosense_band_section* sections; /* likewise; in the order of their points */
  uint32_t section_count;                  /* 0: program time goes on while the spindle stands */
  double spacing;                          /* of its points, s */
  double step;
  double max_shift;
  double shift_step;
  double sync_shift;
  double max_drift;
  double memory_steps;
  double alarm_steps;
  double warning_fraction;
  double release_fraction;
  uint32_t release_steps;
  double air_limit_Nm;
  double steady_share;
  int over_path; /* 1: lengths are of path [m], not of time [s] */
  uint32_t shifts_per_sample;
  double tolerated_stand_ins;
} servosense_torque_band;

typedef struct {
  uint32_t size; /* sizeof(servosense_config): set by servosense_default_config */
  double sample_period_s;
  servosense_drive spindle;
  servosense_drive axis[SERVOSENSE_AXES];
  uint32_t teeth; /* of the tool; 0: not known, or 2 to SERVOSENSE_MAX_TEETH */
  servosense_chatter chatter;
  servosense_collision collision[SERVOSENSE_AXES];
  servosense_cut cut;
  servosense_friction friction;
  servosense_ar_breakage ar_breakage;
  servosense_tooth_breakage tooth_breakage;
  servosense_drill_fracture drill_fracture;
  servosense_wear wear;
  servosense_coefficients coefficients;
  servosense_torque_band torque_band;
  int half_rate; /* drill fracture, wear and torque band hear of two servo periods as of one */
  int grouped;   /* monitors hear of 2 periods of the spindle, of 4 of an axis as of one */
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
  int tells_program;    /* 1: the two below are told */
  int32_t nc_block;     /* that the controller works on */
  double feed_override; /* of the programmed feed; 0: feed hold */
} servosense_sample;

/* A monitor has changed its state. */
typedef struct {
  int monitor;
  int channel;
  int state;
  int before;
  float value;
  float threshold;
  float frequency_hz; /* of the line that raised chatter; value and threshold are of its score then.
                         Else 0 */
  float frequency_error_hz; /* its standard error */
} servosense_event;

typedef struct servosense_stack servosense_stack;

/* SERVOSENSE_CAPI_VERSION of the library, to hold against that of the header. */
uint32_t servosense_version(void);
/* Bytes of storage that a stack takes, and what its address must be a multiple of. */
size_t servosense_size(void);
size_t servosense_alignment(void);

/* Nothing present, no threshold, 8 kHz, cutoffs 335 (collision), 3500 (chatter) and 500 rad/s; all
 * else as the monitors' own defaults. */
void servosense_default_config(servosense_config* config);
/* Number of an effect by its name in the machine file; -1 when there is none. */
int servosense_effect_number(const char* name);

/* Makes a stack in `storage`, which takes less than 4 kB of the caller's stack. NULL when all is
 * well; else a sentence on what is wrong, and `*stack` is NULL. `*parameter` (may be NULL itself)
 * gets the field, as in "axis[0].inertia", or ""; it lies in `storage`. */
const char* servosense_init(void* storage, size_t bytes, const servosense_config* config,
                            servosense_stack** stack, const char** parameter);
/* As after servosense_init, but that wear has to be taught anew and the torque band started. */
void servosense_reset(servosense_stack* stack);
/* The program is at this point of the torque band's reference: call it where the program begins.
 * servosense_init does so with 0. */
void servosense_start_program(servosense_stack* stack, uint32_t point);
/* One servo period. Writes up to `capacity` events and returns how many there were; there are never
 * more than SERVOSENSE_MAX_EVENTS. A stack that servosense_init did not make answers every sample
 * with SERVOSENSE_SIGNAL_FAULT of SERVOSENSE_MACHINE. */
int servosense_process(servosense_stack* stack, const servosense_sample* sample,
                       servosense_event* events, int capacity);

/* A request to hold the feed: 1 from the sample in which an alarm was raised until
 * servosense_release_stop(). An alarm that still stands then is not raised anew: once an event.
 * Both may be called beside servosense_process(), from an interrupt or another thread. */
int servosense_stop_requested(const servosense_stack* stack);
void servosense_release_stop(servosense_stack* stack);

/* Cutting torque [Nm] or force [N] of a channel, of an axis that turns its torque; NaN when it is
 * not there. */
float servosense_estimate(const servosense_stack* stack, int channel);

/* The motor of a channel has this temperature [degC]: call it as often as there is a new one, from
 * the thread of servosense_process(). From then on its effort counts 1 + torque_constant_per_K
 * (temperature - torque_constant_at_C) times; before, as stated. What is not finite is passed over,
 * and so is a temperature at which nothing would be left of the constant. */
void servosense_set_temperature(servosense_stack* stack, int channel, float temperature_C);

/* From the next sample on the stack has a band about each estimate, or no more
 * (docs/estimate-band.md); servosense_init leaves it off. */
void servosense_use_bands(servosense_stack* stack, int use);
/* The force or torque is within servosense_estimate() +- this, at standstill too; NaN without. */
float servosense_estimate_band(const servosense_stack* stack, int channel);

/* What the friction of the spindle has been followed to: 1, or 0 where it is not followed. */
int servosense_followed_friction(const servosense_stack* stack, float* viscous_Nm_s_per_rad,
                                 float* coulomb_Nm);

/* What the cutting coefficients have found. */
enum {
  SERVOSENSE_SPECIFIC_FORCE, /* N/m2, at the chip thickness of the configuration */
  SERVOSENSE_FORCE_RATIO,    /* of it to that of the new tool: a measure of wear */
  SERVOSENSE_K_TC,           /* N/m2 */
  SERVOSENSE_K_TE,           /* N/m */
  SERVOSENSE_K_RC,           /* N/m2 */
  SERVOSENSE_K_RE,           /* N/m */
  SERVOSENSE_RADIAL_RATIO    /* K_rc / K_tc */
};
typedef struct {
  float value; /* NaN: not followed */
  float low;   /* ends of the 95 % interval */
  float high;
  int told; /* 0: the cuts do not tell it; it is what was known before */
} servosense_found;
/* Off the real-time path, in the thread of servosense_process(). */
servosense_found servosense_cutting_coefficient(const servosense_stack* stack, int which);
/* Changes of the specific cutting force at once since the start; `*share` (may be NULL) gets the
 * size of the last one, as a share, or 0. Each is a warning of SERVOSENSE_CUTTING_COEFFICIENTS too.
 */
uint32_t servosense_cutting_changes(const servosense_stack* stack, float* share);
/* From now on cuts are of another depth or width: coefficients and wear go on. 0, or -1 where the
 * coefficients are not followed or the shares are not those of a cut: nothing changes then. */
int servosense_set_cut(servosense_stack* stack, const servosense_cut_shares* shares);
/* Specific cutting force of the new tool [N/m2] with its standard error, which the force ratio is
 * over; 0 while it is not taught yet. Keep it for when the tool comes back. */
typedef struct {
  float specific_force_N_per_m2;
  float error_N_per_m2;
} servosense_taught;
servosense_taught servosense_taught_force(const servosense_stack* stack);
/* Another tool: coefficients are those of the configuration again, and its wear is not known.
 * `taught` (may be NULL): what servosense_taught_force() said when it was last in the spindle. What
 * is known of friction stays; a stop that was asked for stays until servosense_release_stop(). 0,
 * or -1 where the coefficients are not followed or `taught` is negative or not finite: nothing
 * changes then. In the thread of servosense_process(). */
int servosense_new_tool(servosense_stack* stack, const servosense_taught* taught);

/* Faulty samples of a drive since the start: every one, also where no event tells of it. */
uint64_t servosense_faulty_samples(const servosense_stack* stack, int channel);

/* Names as in the event stream; "" for a number that is none. */
const char* servosense_monitor_name(int monitor);
const char* servosense_state_name(int state);
const char* servosense_channel_name(int channel);

#ifdef __cplusplus
}
#endif
#endif
