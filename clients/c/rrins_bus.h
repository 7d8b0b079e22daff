/*
 * A client of the rehearsal's embedded CAN bus, in C11 without dependencies.
 *
 * The protocol is that of docs/bus.md, "The protocol, to the byte", version RRINS_BUS_VERSION.
 * One thread uses a bus at a time. Linux only, little-endian hosts only, as the bus itself.
 */
#ifndef RRINS_BUS_H
#define RRINS_BUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define RRINS_BUS_VERSION 1
#define RRINS_BUS_MAX_FRAMES 4094u

/* Flags of can_id, as in linux/can.h. */
#define RRINS_EFF_FLAG 0x80000000u
#define RRINS_RTR_FLAG 0x40000000u
#define RRINS_ERR_FLAG 0x20000000u

/* Wishes of a node; combined by |. Without RRINS_OBSERVER the bus waits for this node. */
enum {
    RRINS_OBSERVER = 1,
    RRINS_EXCLUSIVE = 2,
    RRINS_RECEIVE_OWN = 4,
    RRINS_IN_STEP = 8
};

#ifndef RRINS_FRAME
#define RRINS_FRAME
/* A classic frame, laid out like struct can_frame of Linux. */
struct rrins_frame {
    uint32_t can_id;
    uint8_t length;
    uint8_t reserved[3];
    uint8_t data[8];
};
#endif

/* Frames that one sender has sent at once. */
struct rrins_batch {
    uint32_t sender;   /* node number; 0 is the host */
    uint64_t epoch;
    int64_t time_ns;   /* simulated, since the hardware's power-on */
    bool closes_epoch; /* its sender has sent everything in this epoch */
    size_t count;
    struct rrins_frame frames[RRINS_BUS_MAX_FRAMES];
};

struct rrins_bus;

/*
 * Attach to a channel: a name such as "rrins0", or the path of its socket.
 *
 * Waits up to timeout_ms for somebody to host it and to answer. Returns NULL if nobody does, if it
 * is not safe, or if the host refuses; `reason` then has one line (size bytes at most).
 */
struct rrins_bus *rrins_bus_attach(const char *channel, const char *name, unsigned wishes,
                                   int timeout_ms, char *reason, size_t size);

/*
 * Receive the next batch, waiting up to timeout_ns; -1 waits for ever.
 *
 * Returns 1 with a batch, 0 when the time is over, -1 when the bus has ended: rrins_bus_reason.
 */
int rrins_bus_receive(struct rrins_bus *bus, struct rrins_batch *batch, int64_t timeout_ns);

/*
 * Send a batch; with closes_epoch it is the last of this sender in this epoch.
 *
 * Returns 0, or -1 when the bus has ended: rrins_bus_reason. While a node holds up the bus, it
 * waits, and keeps what arrives meanwhile for rrins_bus_receive.
 */
int rrins_bus_send(struct rrins_bus *bus, const struct rrins_frame *frames, size_t count,
                   uint64_t epoch, int64_t time_ns, bool closes_epoch);

/* Close an epoch in which there is nothing more to send; returns as rrins_bus_send. */
int rrins_bus_close_epoch(struct rrins_bus *bus, uint64_t epoch, int64_t time_ns);

/* Why the bus has ended: one line. */
const char *rrins_bus_reason(const struct rrins_bus *bus);

/* The node number that the host has given, and a descriptor for poll; what rrins_bus_send kept
 * does not show on it. */
uint32_t rrins_bus_number(const struct rrins_bus *bus);
int rrins_bus_descriptor(const struct rrins_bus *bus);

/* Leave the bus; what was sent still arrives. NULL is nothing to leave. */
void rrins_bus_leave(struct rrins_bus *bus);

#endif
