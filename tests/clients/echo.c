/* Attaches as `firmware`, answers each epoch with its frames doubled, and ends with the bus. */
#include "rrins_bus.h"

#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    char reason[256];
    struct rrins_batch *batch = malloc(sizeof *batch);
    struct rrins_bus *bus;
    size_t k;
    if (argc != 2 || batch == NULL)
        return 2;
    bus = rrins_bus_attach(argv[1], "firmware", RRINS_EXCLUSIVE, 10000, reason, sizeof reason);
    if (bus == NULL) {
        puts(reason);
        free(batch);
        return 1;
    }
    while (rrins_bus_receive(bus, batch, -1) == 1) {
        for (k = 0; k < batch->count; k++)
            batch->frames[k].can_id += 1;
        if (rrins_bus_send(bus, batch->frames, batch->count, batch->epoch, batch->time_ns,
                           batch->closes_epoch) != 0)
            break;
    }
    puts(rrins_bus_reason(bus));
    rrins_bus_leave(bus);
    free(batch);
    return 0;
}
