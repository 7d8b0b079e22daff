/*
 * The navigation computer of a build, epoch by epoch from standard input to standard output: what
 * it gets and sends, and after the last epoch its memory. Its seeds are those of the test.
 *
 *     answers [MEMORY]
 */
#include <stdio.h>
#include <string.h>

#include "firmware.h"
#include "uds.h"

enum { INBOX = 4096 };

static struct firmware firmware;
static struct rrins_frame inbox[INBOX], outbox[OUTBOX];

bool random_bytes(uint8_t *at, size_t size)
{
    static uint64_t drawn;
    drawn += UINT64_C(0x9E3779B97F4A7C15);
    for (size_t k = 0; k < size; k++)
        at[k] = (uint8_t)(drawn >> 8 * (k % 8));
    return true;
}

int main(int count, char **words)
{
    struct setup setup;
    char reason[256] = "";
    int64_t head[2]; /* frames, arrival of SYNC */
    if (!setup_read(&setup, NULL, reason, sizeof reason) ||
        (count > 1 && !firmware_remember(words[1], reason, sizeof reason))) {
        fprintf(stderr, "%s\n", reason);
        return 1;
    }
    firmware_power_on(&firmware, &setup);
    firmware.is_whole = true;
    while (fread(head, sizeof head, 1, stdin) == 1 && head[0] >= 0) {
        size_t consumed;
        int64_t sent;
        if (head[0] > INBOX || fread(inbox, sizeof *inbox, (size_t)head[0], stdin) != (size_t)head[0])
            return 2;
        firmware.sync_arrival_ns = head[1];
        sent = (int64_t)firmware_step(&firmware, inbox, (size_t)head[0], &consumed, outbox);
        fwrite(&sent, sizeof sent, 1, stdout);
        fwrite(outbox, sizeof *outbox, (size_t)sent, stdout);
        fflush(stdout);
    }
    fwrite(&firmware.ram, sizeof firmware.ram, 1, stdout);
    return 0;
}
