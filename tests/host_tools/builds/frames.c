/* Both steps in a loop: writes the frames of each epoch, the hardware's, then the firmware's. */
#include <stdio.h>
#include <stdlib.h>

#include "rrins_firmware.h"
#include "rrins_hardware.h"

extern const double rrins_motion[];
extern const int32_t rrins_motion_pieces;

static struct rrins_firmware_ram ram;
static struct rrins_hardware_plant plant;
static struct rrins_frame up[RRINS_HARDWARE_OUTBOX], down[RRINS_FIRMWARE_OUTBOX];

int main(int count, char **words)
{
    long epochs = count > 1 ? strtol(words[1], NULL, 10) : 0;
    int32_t sent = 0;
    rrins_firmware_power_on(&ram);
    rrins_hardware_power_on(&plant);
    for (int64_t epoch = 0; epoch < epochs; epoch++) {
        int32_t received = rrins_hardware_step(&plant, rrins_motion, rrins_motion_pieces,
                                               rrins_contract, down, sent, up);
        ram.clock.sync_arrival_ns = epoch * (1000000000 / RRINS_RATE_HZ);
        ram.clock.is_whole = 1;
        sent = rrins_firmware_step(&ram, rrins_contract, up, received, down);
        if (fwrite(up, sizeof *up, (size_t)received, stdout) != (size_t)received ||
            fwrite(down, sizeof *down, (size_t)sent, stdout) != (size_t)sent)
            return 1;
    }
    return 0;
}
