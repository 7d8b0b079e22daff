/* ISO-TP (ISO 15765-2) on a classic bus, timed by the epochs. */
#ifndef ISOTP_H
#define ISOTP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "rrins_diagnostics.h"

enum { RESPONSES = 8, OUT_FRAMES = 256, RING = 2 * WAITING_FRAMES }; /* that may wait */

struct message {
    size_t size;
    uint8_t at[MESSAGE_CAPACITY + 1];
};

struct timer {
    bool runs;
    int64_t start_ns, length_ns;
};

struct can_data {
    uint16_t can_id;
    uint8_t size, at[8];
};

struct isotp {
    int64_t now_ns, slot_ns;
    /* from the bus */
    struct can_data waiting[RING];
    size_t waiting_first, waiting_count, fed; /* fed: those of them to process now */
    struct message functional[REQUESTS];
    size_t functional_first, functional_count;
    struct message requests[REQUESTS];
    size_t request_first, request_count;
    /* of the request that is being received */
    bool is_receiving;
    struct message received;
    size_t announced;
    uint8_t last_sequence;
    size_t in_block; /* consecutive frames since flow control */
    struct timer consecutive;
    bool flow_due, flow_overflow;
    bool has_flow;
    uint8_t flow[3];
    /* of the responses */
    struct message responses[RESPONSES];
    size_t response_first, response_count; /* the first may be being sent */
    enum { SENDING_NOTHING, AWAITING_FLOW, SENDING_REST } sending;
    size_t sent_bytes;
    uint8_t sequence, block, blocks_sent;
    unsigned waits;
    struct timer flow_awaited, separation;
    uint8_t out[OUT_FRAMES][8];
    size_t out_count;
};

void isotp_reset(struct isotp *tp);
bool isotp_is_idle(const struct isotp *tp);
bool isotp_is_sending(const struct isotp *tp);

/* Queue a frame from the bus; `isotp_begin` processes it. */
void isotp_put(struct isotp *tp, uint16_t can_id, const uint8_t *data, size_t size);

/* Begin an epoch: process the queued frames, up to the limit of an epoch. */
void isotp_begin(struct isotp *tp, int64_t now_ns);

/* The next request, or NULL; it lasts until the next epoch. */
const struct message *isotp_functional(struct isotp *tp);
const struct message *isotp_request(struct isotp *tp);

/* How long sending takes, if the tool asks for no pauses. */
int64_t isotp_sending_ns(const struct isotp *tp, size_t size);

/* Begin to send; false if too many responses wait. */
bool isotp_send(struct isotp *tp, const uint8_t *response, size_t size);

/* End the epoch: the number of frames to send in it, eight bytes each. */
size_t isotp_end(struct isotp *tp, uint8_t frames[SLOTS][8]);

#endif
