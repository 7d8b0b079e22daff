/* Diagnostics between two steps of the firmware: frames in, frames out, and the memories. */
#ifndef DIAGNOSTICS_H
#define DIAGNOSTICS_H

#include <stdbool.h>
#include <stddef.h>

#include "rrins_firmware.h"

/* Most frames that are added to an epoch's. */
enum { DIAGNOSTIC_FRAMES = RRINS_RATE_HZ >= 800 ? 1 : 800 / RRINS_RATE_HZ };

/*
 * Keep the parameters in a file, the trouble codes beside it; without, they last until the program
 * ends. False with a reason if a file cannot be used.
 */
bool diagnostics_open(const char *path, char *reason, size_t size);

/* Begin: make the memory what it is at power-on. */
void diagnostics_power_on(struct rrins_firmware_ram *ram);

/* Restart the computer if a tool has asked for that; to be called before a step. */
bool diagnostics_restart_if_due(void);

/*
 * Do one epoch's share of the work, after its step: the number of frames in outbox now, the last of
 * which stays last. `waits`: whether to stop for the files.
 */
size_t diagnostics_run(const struct rrins_frame *inbox, size_t count, struct rrins_frame *outbox,
                       size_t sent, bool waits);

/* Wait until both memories are stored. */
void diagnostics_close(void);

#endif
