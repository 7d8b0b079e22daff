/*
 * The rehearsed navigation computer, as the shell in main.c sees it: the step in machine code, with
 * the few values of its memory that a shell reads and writes.
 */
#ifndef FIRMWARE_H
#define FIRMWARE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "diagnostics.h"
#include "rrins_bus.h"
#include "rrins_firmware.h"

#define PROGRAM "navigator"

enum { OUTBOX = RRINS_FIRMWARE_OUTBOX + DIAGNOSTIC_FRAMES };

/* The set-up is built in; a file must say the same. */
struct setup {
    int64_t period_ns;
};

bool setup_read(struct setup *setup, const char *path, char *reason, size_t size);

/* Keep parameters and trouble codes in files; false with a reason if they cannot be used. */
bool firmware_remember(const char *path, char *reason, size_t size);

struct clock {
    bool synchronised, lost;
    int64_t next_ns;
};

struct faults {
    int64_t overruns;
};

struct firmware {
    int64_t period_ns, epoch, sync_arrival_ns;
    bool is_whole;
    struct clock clock;
    struct faults faults;
    double load_percent;
    struct rrins_firmware_ram ram;
};

void firmware_power_on(struct firmware *firmware, const struct setup *setup);

/* Run an epoch; the number of frames in outbox. `consumed` is the first that belongs to a later. */
size_t firmware_step(struct firmware *firmware, const struct rrins_frame *inbox, size_t count,
                     size_t *consumed, struct rrins_frame *outbox);

bool firmware_is_shut_down(const struct firmware *firmware);

/* The frame that announces the computer before the first epoch. */
void heartbeat(struct firmware *firmware, struct rrins_frame *frame);

#endif
