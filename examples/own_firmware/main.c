/*
 * own_firmware: a navigation computer on the rehearsal's bus.
 *
 *     own_firmware --setup FILE --interface rrins|socketcan --channel CHANNEL --speed max|1
 *
 * The shells own time and the bus, and run the step: in lockstep the hardware opens an epoch and
 * this closes it; in real time (speed 1) it keeps deadlines by its own clock.
 */
#define _GNU_SOURCE
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "port.h"
#include "rrins.h"

enum { INBOX = 8192, FIFO_PRIORITY = 50, HELLO_NS = 200000000 };
enum { GRACE_SLICES = 4, GRACES_AT_MOST = 4 }; /* of the wait for a late epoch */

struct options {
    const char *setup, *interface, *channel, *speed, *memory;
    double attach_wait_s;
};

static struct firmware firmware;
static struct rrins_frame inbox[INBOX], outbox[OUTBOX];
static int64_t arrival_ns[INBOX];
volatile sig_atomic_t stopped;

/* End with the present epoch, so that all is kept. */
static void stop(int number)
{
    stopped = number;
}

/* After all else: whoever waits for this program learns of the signal. */
static void end_by_signal(void)
{
    if (stopped) {
        signal(stopped, SIG_DFL);
        raise(stopped);
    }
}

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static bool is_in(uint32_t can_id, size_t count)
{
    for (size_t k = 0; k < count; k++)
        if (inbox[k].can_id == can_id)
            return true;
    return false;
}

/* On a bus that does not tell who is there: announce this computer until the hardware begins. */
static bool announce(struct port *port)
{
    struct rrins_frame hello;
    while (!stopped && !port_has_frames(port, HELLO_NS)) {
        heartbeat(&firmware, &hello);
        if (!port_send(port, &hello, 1, 0, 0))
            return false;
    }
    return true;
}

static bool run_lockstep(struct port *port)
{
    int64_t arrivals = 0;
    firmware.is_whole = true;
    while (!stopped && !firmware_is_shut_down(&firmware)) {
        size_t consumed, sent;
        long count = port_receive_epoch(port, inbox, INBOX);
        if (count < 0)
            return false;
        firmware.sync_arrival_ns = arrivals++ * firmware.period_ns;
        sent = firmware_step(&firmware, inbox, (size_t)count, &consumed, outbox);
        if (!port_send(port, outbox, sent, firmware.epoch, firmware.epoch * firmware.period_ns))
            return false;
    }
    return true;
}

/* Gather frames until a deadline, or until the epoch is whole; -1 at the end of the bus. */
static long gather(struct port *port, size_t count, int64_t deadline_ns, bool until_whole)
{
    while (count < INBOX) {
        int64_t left_ns = deadline_ns - now_ns();
        long came = port_receive(port, &inbox[count], INBOX - count, left_ns > 0 ? left_ns : 0);
        int64_t at_ns = now_ns();
        if (came < 0)
            return -1;
        for (long k = 0; k < came; k++)
            arrival_ns[count + (size_t)k] = at_ns;
        count += (size_t)came;
        if (until_whole && is_in(RRINS_AXIS_OUTER_STATUS_FRAME_ID, count))
            break;
        if (came == 0 && now_ns() >= deadline_ns)
            break;
    }
    return (long)count;
}

/*
 * Gather frames for a period, or until the epoch is whole; -1 at the end of the bus. A slice that
 * ends late shows a stall, for which the other side may have stood still, too: the wait begins
 * anew, but not for ever.
 */
static long wait_for_late_frames(struct port *port, long count, int64_t period_ns)
{
    int64_t slice_ns = period_ns / GRACE_SLICES;
    int on_time = 0;
    for (int k = 0; k < GRACES_AT_MOST * GRACE_SLICES && on_time < GRACE_SLICES; k++) {
        int64_t end_ns = now_ns() + slice_ns;
        if (count < 0 || is_in(RRINS_AXIS_OUTER_STATUS_FRAME_ID, (size_t)count))
            break;
        count = gather(port, (size_t)count, end_ns, true);
        on_time = now_ns() - end_ns > slice_ns / 2 ? 0 : on_time + 1;
    }
    return count;
}

/* Keep the arrival of the first SYNC in the inbox, if there is one. */
static void note_sync(size_t count)
{
    for (size_t k = 0; k < count; k++)
        if (inbox[k].can_id == RRINS_SYNC_FRAME_ID) {
            firmware.sync_arrival_ns = arrival_ns[k];
            return;
        }
}

static void enter_realtime(void)
{
    struct sched_param parameters = {.sched_priority = FIFO_PRIORITY};
    /* By the kernel's call: musl's function refuses always. What is refused is gone without. */
    (void)syscall(SYS_sched_setscheduler, 0, SCHED_FIFO, &parameters);
    (void)mlockall(MCL_CURRENT | MCL_FUTURE);
}

static bool run_realtime(struct port *port)
{
    int64_t period_ns = firmware.period_ns, deadline_ns = now_ns() + period_ns;
    long count = 0;
    while (!stopped && !firmware_is_shut_down(&firmware)) {
        const struct clock *clock = &firmware.clock;
        bool is_followed = clock->synchronised && !clock->lost;
        size_t consumed, sent;
        int64_t begin_ns;
        count = gather(port, (size_t)count, deadline_ns, false);
        firmware.faults.overruns += clock->synchronised && now_ns() - deadline_ns > period_ns;
        if (is_followed)
            count = wait_for_late_frames(port, count, period_ns);
        if (count < 0)
            return false;
        begin_ns = now_ns();
        note_sync((size_t)count);
        sent = firmware_step(&firmware, inbox, (size_t)count, &consumed, outbox);
        count -= (long)consumed;
        memmove(inbox, inbox + consumed, (size_t)count * sizeof *inbox);
        memmove(arrival_ns, arrival_ns + consumed, (size_t)count * sizeof *arrival_ns);
        if (!port_send(port, outbox, sent, firmware.epoch, firmware.epoch * period_ns))
            return false;
        firmware.load_percent += (100.0 * (double)(now_ns() - begin_ns) / (double)period_ns -
                                  firmware.load_percent) / 16.0;
        deadline_ns = clock->synchronised ? clock->next_ns + period_ns / 2
                                          : deadline_ns + period_ns;
    }
    return true;
}

static bool read_options(struct options *options, int count, char **words)
{
    for (int k = 1; k + 1 < count; k += 2) {
        if (strcmp(words[k], "--setup") == 0)
            options->setup = words[k + 1];
        else if (strcmp(words[k], "--interface") == 0)
            options->interface = words[k + 1];
        else if (strcmp(words[k], "--channel") == 0)
            options->channel = words[k + 1];
        else if (strcmp(words[k], "--speed") == 0)
            options->speed = words[k + 1];
        else if (strcmp(words[k], "--memory") == 0)
            options->memory = words[k + 1];
        else if (strcmp(words[k], "--attach-wait") == 0)
            options->attach_wait_s = strtod(words[k + 1], NULL);
        else
            return false;
    }
    return count % 2 == 1;
}

int main(int count, char **words)
{
    struct options options = {NULL, "rrins", "rrins0", "1", NULL, 10.0};
    struct setup setup;
    struct port port;
    char reason[256];
    bool is_well;
    atexit(end_by_signal);
    if (!read_options(&options, count, words)) {
        fprintf(stderr, "usage: %s [--setup FILE] [--interface rrins|socketcan] [--channel CHANNEL] "
                        "[--speed max|1] [--attach-wait SECONDS] [--memory FILE]\n", words[0]);
        return 2;
    }
    if (!setup_read(&setup, options.setup, reason, sizeof reason)) {
        fprintf(stderr, PROGRAM ": %s: %s\n", options.setup == NULL ? "--setup" : options.setup,
                reason);
        return 1;
    }
    if (options.memory != NULL && !firmware_remember(options.memory, reason, sizeof reason)) {
        fprintf(stderr, PROGRAM ": %s: %s\n", options.memory, reason);
        return 1;
    }
    firmware_power_on(&firmware, &setup);
    is_well = port_open(&port, options.interface, options.channel,
                        (int)(options.attach_wait_s * 1000.0));
    sigaction(SIGTERM, &(struct sigaction){.sa_handler = stop}, NULL);
    sigaction(SIGINT, &(struct sigaction){.sa_handler = stop}, NULL);
    if (is_well && strcmp(options.speed, "1") == 0) {
        enter_realtime();
        is_well = run_realtime(&port);
    } else if (is_well) {
        is_well = announce(&port) && run_lockstep(&port);
    }
    if (!is_well && !stopped)
        fprintf(stderr, PROGRAM ": %s\n", port.reason);
    port_close(&port);
    return is_well ? 0 : 1;
}
