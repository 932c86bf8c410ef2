/* A machine file (docs/files.md) as configuration of the C interface. For hosts: it reads files and
 * allocates, so call it before the real-time loop. Link servosense::c_files. */
#ifndef SERVOSENSE_CAPI_MACHINE_FILE_H
#define SERVOSENSE_CAPI_MACHINE_FILE_H

#include "servosense/capi/servosense.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What the drives report; a channel whose `motion` is negative does not report. */
typedef struct {
  double sample_period_s;
  int motion[1 + SERVOSENSE_AXES];  /* of a channel: SERVOSENSE_COUNTS ... or -1 */
  int current[1 + SERVOSENSE_AXES]; /* 1: effort is a current [A]; 0: torque [Nm] or force [N] */
} servosense_signals;

/* 0 when `config` was filled, with all that the file has for monitors and effects; else -1 and a
 * sentence in `error`. Monitors without a threshold in the file are off. */
int servosense_config_from_file(const char* path, const servosense_signals* signals,
                                servosense_config* config, char* error, size_t error_bytes);
/* Gives back what servosense_config_from_file has allocated for effects and reference. Not while a
 * stack with a torque band is in use. */
void servosense_free_config(servosense_config* config);

#ifdef __cplusplus
}
#endif
#endif
