#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "diagnostics.h"
#include "digest.h"
#include "firmware.h"

/* From rrins_images.o. */
extern const char rrins_setup[];
extern const int32_t rrins_setup_bytes;
extern const struct rrins_frame rrins_hello;

/* Of the navigation output of all epochs. */
static struct sha256 navigated;
static bool has_navigated;

/* What a rehearsal compares with the run of another firmware: `navigation_sha256` of a summary. */
static void tell_digest(void)
{
    uint8_t digest[SHA256_SIZE];
    if (!has_navigated)
        return;
    sha256_end(&navigated, digest);
    printf("navigation_sha256 ");
    for (int k = 0; k < SHA256_SIZE; k++)
        printf("%02x", digest[k]);
    printf("\n");
}

bool setup_read(struct setup *setup, const char *path, char *reason, size_t size)
{
    size_t expected = (size_t)rrins_setup_bytes, came;
    char *text;
    FILE *file;
    bool is_same;
    setup->period_ns = 1000000000 / RRINS_RATE_HZ;
    if (path == NULL)
        return true;
    file = fopen(path, "rb");
    if (file == NULL) {
        snprintf(reason, size, "cannot be read");
        return false;
    }
    text = malloc(expected + 1);
    came = text == NULL ? 0 : fread(text, 1, expected + 1, file);
    is_same = came == expected && memcmp(text, rrins_setup, expected) == 0;
    fclose(file);
    free(text);
    if (!is_same)
        snprintf(reason, size, "another set-up than this program was built for: rrins build");
    return is_same;
}

bool firmware_remember(const char *path, char *reason, size_t size)
{
    return diagnostics_open(path, reason, size) && atexit(diagnostics_close) == 0;
}

void firmware_power_on(struct firmware *firmware, const struct setup *setup)
{
    memset(firmware, 0, sizeof *firmware);
    diagnostics_power_on(&firmware->ram);
    firmware->period_ns = setup->period_ns;
    sha256_begin(&navigated);
    atexit(tell_digest);
}

size_t firmware_step(struct firmware *firmware, const struct rrins_frame *inbox, size_t count,
                     size_t *consumed, struct rrins_frame *outbox)
{
    struct rrins_firmware_ram *ram = &firmware->ram;
    int32_t sent;
    if (diagnostics_restart_if_due()) {
        firmware->faults.overruns = 0;
        firmware->load_percent = 0.0;
    }
    ram->clock.sync_arrival_ns = firmware->sync_arrival_ns;
    ram->clock.is_whole = firmware->is_whole;
    ram->faults.overruns = firmware->faults.overruns;
    ram->load_percent = firmware->load_percent;
    sent = rrins_firmware_step(ram, rrins_contract, inbox, (int32_t)count, outbox);
    if (ram->modes.mode == RRINS_MODE_NAVIGATION_STRAPDOWN ||
        ram->modes.mode == RRINS_MODE_NAVIGATION_ROTATING) {
        sha256_add(&navigated, &ram->navigation, sizeof ram->navigation);
        has_navigated = true;
    }
    firmware->epoch = ram->epoch;
    firmware->clock.synchronised = ram->clock.synchronised;
    firmware->clock.lost = ram->clock.sync_lost;
    firmware->clock.next_ns = ram->clock.next_sync_ns;
    *consumed = (size_t)ram->consumed;
    if (sent <= 0)
        return 0;
    return diagnostics_run(inbox, *consumed, outbox, (size_t)sent, firmware->is_whole);
}

bool firmware_is_shut_down(const struct firmware *firmware)
{
    return firmware->ram.modes.mode == RRINS_MODE_SHUTDOWN;
}

void heartbeat(struct firmware *firmware, struct rrins_frame *frame)
{
    (void)firmware;
    *frame = rrins_hello;
}
