#define _GNU_SOURCE
#include "port.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "rrins.h"

_Static_assert(sizeof(struct can_frame) == sizeof(struct rrins_frame), "one layout of frames");

static const int64_t SILENCE_NS = INT64_C(30000000000); /* of the hardware, in lockstep */
static const int64_t SLICE_NS = 100000000; /* of a wait that a signal may end */
enum { KEPT_FREE = 1024 }; /* room for the hardware's frames, whatever others send */

static bool open_can(struct port *port, const char *channel)
{
    struct sockaddr_can address = {.can_family = AF_CAN};
    port->can = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
    address.can_ifindex = (int)if_nametoindex(channel);
    if (port->can >= 0 && address.can_ifindex > 0 &&
        bind(port->can, (const struct sockaddr *)&address, sizeof address) == 0)
        return true;
    snprintf(port->reason, sizeof port->reason, "cannot open socketcan:%s: %s", channel,
             strerror(errno));
    return false;
}

bool port_open(struct port *port, const char *interface, const char *channel, int wait_ms)
{
    memset(port, 0, sizeof *port);
    port->can = -1;
    if (strcmp(interface, "socketcan") == 0)
        return open_can(port, channel);
    if (strcmp(interface, "rrins") != 0) {
        snprintf(port->reason, sizeof port->reason, "no interface %s: rrins or socketcan",
                 interface);
        return false;
    }
    port->batch = calloc(1, sizeof *port->batch);
    if (port->batch == NULL) {
        snprintf(port->reason, sizeof port->reason, "no memory");
        return false;
    }
    port->bus = rrins_bus_attach(channel, "firmware", RRINS_EXCLUSIVE, wait_ms, port->reason,
                                 sizeof port->reason);
    return port->bus != NULL;
}

void port_close(struct port *port)
{
    rrins_bus_leave(port->bus);
    free(port->batch);
    if (port->can >= 0)
        close(port->can);
}

static long ended(struct port *port, const char *why)
{
    snprintf(port->reason, sizeof port->reason, "%s", why);
    return -1;
}

/* Copy what is left of the batch, as far as there is room. */
static size_t copied(struct port *port, struct rrins_frame *frames, size_t room)
{
    size_t left = port->batch->count - port->taken;
    size_t count = left < room ? left : room;
    memcpy(frames, port->batch->frames + port->taken, count * sizeof *frames);
    port->taken += count;
    return count;
}

bool port_has_frames(struct port *port, int64_t timeout_ns)
{
    struct pollfd wait = {.fd = port->can, .events = POLLIN};
    struct timespec left = {(time_t)(timeout_ns / 1000000000), (long)(timeout_ns % 1000000000)};
    return port->bus != NULL || ppoll(&wait, 1, timeout_ns < 0 ? NULL : &left, NULL) > 0;
}

static long receive_can(struct port *port, struct rrins_frame *frames, size_t room,
                        int64_t timeout_ns)
{
    size_t count = 0;
    if (!port_has_frames(port, timeout_ns))
        return 0;
    while (count < room) {
        ssize_t came = recv(port->can, &frames[count], sizeof *frames, MSG_DONTWAIT);
        if (came < 0)
            return errno == EAGAIN ? (long)count : ended(port, strerror(errno));
        count++;
    }
    return (long)count;
}

long port_receive(struct port *port, struct rrins_frame *frames, size_t room, int64_t timeout_ns)
{
    if (port->bus == NULL)
        return receive_can(port, frames, room, timeout_ns);
    if (port->taken == port->batch->count) {
        int came = rrins_bus_receive(port->bus, port->batch, timeout_ns);
        if (came < 0)
            return ended(port, rrins_bus_reason(port->bus));
        if (came == 0)
            return 0;
        port->taken = 0;
    }
    return (long)copied(port, frames, room);
}

/* On SocketCAN the frame of the outer axis closes the hardware's epoch. */
static long receive_can_epoch(struct port *port, struct rrins_frame *frames, size_t room)
{
    size_t count = 0;
    int64_t silent_ns = 0;
    while (!stopped) {
        long came = receive_can(port, &frames[count], 1, SLICE_NS);
        if (came < 0)
            return -1;
        silent_ns = came > 0 ? 0 : silent_ns + SLICE_NS;
        if (silent_ns >= SILENCE_NS)
            return ended(port, "the hardware has been silent for 30 s");
        if (came == 0)
            continue;
        if (frames[count].can_id == RRINS_AXIS_OUTER_STATUS_FRAME_ID)
            return (long)count + 1;
        if (count + 1 < room)
            count++;
    }
    return -1;
}

long port_receive_epoch(struct port *port, struct rrins_frame *frames, size_t room)
{
    size_t count = 0;
    if (port->bus == NULL)
        return receive_can_epoch(port, frames, room);
    while (!stopped) {
        int came = rrins_bus_receive(port->bus, port->batch, SLICE_NS);
        if (came < 0)
            return ended(port, rrins_bus_reason(port->bus));
        if (came == 0)
            continue;
        port->taken = 0;
        count += copied(port, &frames[count], room - count);
        port->taken = port->batch->count;
        if (port->batch->closes_epoch)
            return (long)count;
        if (count > room - KEPT_FREE) /* a flood of others */
            count = room - KEPT_FREE;
    }
    return -1;
}

static bool send_can(struct port *port, const struct rrins_frame *frame)
{
    while (send(port->can, frame, sizeof *frame, 0) < 0) {
        const struct timespec pause = {0, 100000};
        if (errno != ENOBUFS && errno != EAGAIN && errno != EINTR)
            return ended(port, strerror(errno)) == 0;
        nanosleep(&pause, NULL);
    }
    return true;
}

bool port_send(struct port *port, const struct rrins_frame *frames, size_t count, int64_t epoch,
               int64_t time_ns)
{
    if (port->bus != NULL)
        return rrins_bus_send(port->bus, frames, count, (uint64_t)epoch, time_ns, true) == 0 ||
               ended(port, rrins_bus_reason(port->bus)) == 0;
    for (size_t k = 0; k < count; k++)
        if (!send_can(port, &frames[k]))
            return false;
    return true;
}
