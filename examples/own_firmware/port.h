/* The computer's port on the bus: the rehearsal's embedded bus, or SocketCAN. */
#ifndef PORT_H
#define PORT_H

#include <signal.h>

#include "firmware.h"

extern volatile sig_atomic_t stopped; /* the signal that ends the program, 0 without */

struct port {
    struct rrins_bus *bus; /* embedded, or NULL */
    struct rrins_batch *batch;
    size_t taken; /* frames of the batch that were received already */
    int can;      /* SocketCAN */
    char reason[640];
};

bool port_open(struct port *port, const char *interface, const char *channel, int wait_ms);
void port_close(struct port *port);

/* Wait up to timeout_ns for frames; whether some are there. True on the embedded bus. */
bool port_has_frames(struct port *port, int64_t timeout_ns);

/* Receive frames, waiting up to timeout_ns (-1: for ever); 0 when it is over, -1 at the end. */
long port_receive(struct port *port, struct rrins_frame *frames, size_t room, int64_t timeout_ns);

/* Receive until the hardware has closed its epoch; the number of frames, -1 at the end. */
long port_receive_epoch(struct port *port, struct rrins_frame *frames, size_t room);

/* Send an epoch's frames and close the epoch; false at the end. */
bool port_send(struct port *port, const struct rrins_frame *frames, size_t count, int64_t epoch,
               int64_t time_ns);

#endif
