#include "isotp.h"

#include <string.h>

enum { SINGLE, FIRST, CONSECUTIVE, FLOW };
enum { GO_ON, WAIT, OVERFLOW_, FLOW_STATES };
enum { CAN_BYTES = 8, FIRST_BYTES = 6, CONSECUTIVE_BYTES = 7, MOST_WAITS = 10 };

static void start(struct timer *timer, int64_t now_ns, int64_t length_ns)
{
    *timer = (struct timer){true, now_ns, length_ns};
}

static bool is_over(const struct timer *timer, int64_t now_ns)
{
    return timer->runs && now_ns - timer->start_ns >= timer->length_ns;
}

static bool is_transmitting(const struct isotp *tp)
{
    return tp->response_count > 0;
}

static void stop_receiving(struct isotp *tp)
{
    tp->is_receiving = false;
    tp->received.size = 0;
    tp->flow_due = tp->has_flow = false;
    tp->consecutive.runs = false;
}

static void stop_sending(struct isotp *tp)
{
    if (tp->sending != SENDING_NOTHING) {
        tp->response_first = (tp->response_first + 1) % RESPONSES;
        tp->response_count--;
    }
    tp->sending = SENDING_NOTHING;
    tp->flow_awaited.runs = tp->separation.runs = false;
    tp->waits = 0;
}

void isotp_reset(struct isotp *tp)
{
    memset(tp, 0, sizeof *tp);
    tp->slot_ns = PERIOD_NS / SLOTS;
}

bool isotp_is_sending(const struct isotp *tp)
{
    return is_transmitting(tp) || tp->out_count > 0;
}

bool isotp_is_idle(const struct isotp *tp)
{
    return tp->waiting_count == 0 && tp->functional_count == 0 && tp->request_count == 0 &&
           !isotp_is_sending(tp) && !tp->is_receiving;
}

void isotp_put(struct isotp *tp, uint16_t can_id, const uint8_t *data, size_t size)
{
    struct can_data *frame;
    if (tp->waiting_count - tp->fed >= WAITING_FRAMES || tp->waiting_count == RING)
        return;
    frame = &tp->waiting[(tp->waiting_first + tp->waiting_count++) % RING];
    frame->can_id = can_id;
    frame->size = (uint8_t)size;
    memcpy(frame->at, data, size);
}

static bool is_single(const struct can_data *frame)
{
    size_t length;
    if (frame->size == 0 || frame->at[0] >> 4 != SINGLE)
        return false;
    length = frame->at[0];
    return length >= 1 && length <= CAN_BYTES - 1 && length < frame->size;
}

/* Whether a first frame is complete, and announces more than a single frame holds. */
static bool is_first(const struct can_data *frame)
{
    uint32_t length;
    if (frame->size != CAN_BYTES)
        return false;
    length = (uint32_t)(frame->at[0] & 0x0F) << 8 | frame->at[1];
    if (length == 0)
        return ((uint32_t)frame->at[2] << 24 | (uint32_t)frame->at[3] << 16 |
                (uint32_t)frame->at[4] << 8 | frame->at[5]) > MESSAGE_CAPACITY;
    return length >= CAN_BYTES;
}

/* Whether a frame is not to be ignored, ISO 15765-2:2016, 9.6 and 9.8.3. */
static bool is_accepted(const struct isotp *tp, const struct can_data *frame)
{
    size_t missing = tp->announced - tp->received.size;
    if (frame->size == 0)
        return false;
    switch (frame->at[0] >> 4) {
    case SINGLE:
        return is_single(frame);
    case FIRST:
        return is_first(frame);
    case CONSECUTIVE:
        return tp->is_receiving &&
               frame->size > (missing < CONSECUTIVE_BYTES ? missing : CONSECUTIVE_BYTES);
    case FLOW:
        return tp->sending == AWAITING_FLOW && frame->size >= 3;
    default:
        return false;
    }
}

static struct message *queued(struct message *queue, size_t *first, size_t *count)
{
    if (*count == REQUESTS) { /* the oldest is lost */
        *first = (*first + 1) % REQUESTS;
        --*count;
    }
    return &queue[(*first + (*count)++) % REQUESTS];
}

static void keep(struct message *message, const uint8_t *data, size_t size)
{
    message->size = size;
    memcpy(message->at, data, size);
}

static void receive_first(struct isotp *tp, const struct can_data *frame)
{
    size_t length = (size_t)(frame->at[0] & 0x0F) << 8 | frame->at[1];
    tp->received.size = 0;
    tp->last_sequence = 0;
    tp->in_block = 0;
    tp->flow_due = true;
    tp->flow_overflow = length == 0; /* announces more than there is room for */
    tp->is_receiving = !tp->flow_overflow;
    if (tp->is_receiving) {
        tp->announced = length;
        keep(&tp->received, frame->at + 2, FIRST_BYTES);
        start(&tp->consecutive, tp->now_ns, N_CR_NS);
    }
}

static void receive_consecutive(struct isotp *tp, const struct can_data *frame)
{
    size_t missing = tp->announced - tp->received.size;
    size_t size = (size_t)frame->size - 1;
    if ((frame->at[0] & 0x0F) != ((tp->last_sequence + 1) & 0x0F)) {
        stop_receiving(tp);
        return;
    }
    start(&tp->consecutive, tp->now_ns, N_CR_NS);
    tp->last_sequence = frame->at[0] & 0x0F;
    size = size < missing ? size : missing;
    memcpy(tp->received.at + tp->received.size, frame->at + 1, size);
    tp->received.size += size;
    if (tp->received.size < tp->announced) {
        if (++tp->in_block == BLOCK_SIZE) {
            tp->in_block = 0;
            tp->flow_due = true;
            tp->consecutive.runs = false; /* until the flow control is sent */
        }
        return;
    }
    keep(queued(tp->requests, &tp->request_first, &tp->request_count), tp->received.at,
         tp->received.size);
    stop_receiving(tp);
}

/* Process a frame; whether something is to be sent at once. */
static bool receive(struct isotp *tp, const struct can_data *frame)
{
    int type = frame->at[0] >> 4;
    if (type == FLOW) {
        memcpy(tp->flow, frame->at, sizeof tp->flow);
        tp->has_flow = true;
        return true;
    }
    if (!tp->is_receiving)
        tp->consecutive.runs = false;
    if (type == SINGLE) {
        keep(queued(tp->requests, &tp->request_first, &tp->request_count), frame->at + 1,
             frame->at[0]);
        tp->is_receiving = false;
    } else if (type == FIRST) {
        receive_first(tp, frame);
    } else if (tp->is_receiving) {
        receive_consecutive(tp, frame);
    }
    return tp->flow_due;
}

/* Receive until something is to be sent at once. */
static void receive_all(struct isotp *tp)
{
    bool is_urgent = false, came = true;
    while (came && !is_urgent) {
        const struct can_data *frame = NULL;
        came = false;
        while (tp->fed > 0 && !came) {
            frame = &tp->waiting[tp->waiting_first];
            tp->waiting_first = (tp->waiting_first + 1) % RING;
            tp->waiting_count--;
            tp->fed--;
            if (frame->can_id != REQUEST_ID || !is_accepted(tp, frame))
                continue;
            if (frame->at[0] >> 4 == FLOW && (frame->at[0] & 0x0F) >= FLOW_STATES)
                stop_sending(tp); /* a reserved status */
            else
                came = true;
        }
        if (is_over(&tp->consecutive, tp->now_ns))
            stop_receiving(tp);
        if (came)
            is_urgent = receive(tp, frame);
    }
}

static uint8_t *new_frame(struct isotp *tp)
{
    uint8_t *frame = tp->out[tp->out_count];
    if (tp->out_count + 1 < OUT_FRAMES) /* beyond, the last one is lost */
        tp->out_count++;
    memset(frame, PADDING, CAN_BYTES);
    return frame;
}

static int64_t separation_ns(const struct isotp *tp, uint8_t wanted)
{
    int64_t ns = 127000000; /* of reserved values: the longest */
    if (wanted <= 0x7F)
        ns = wanted * INT64_C(1000000);
    else if (wanted >= 0xF1 && wanted <= 0xF9)
        ns = (wanted - 0xF0) * INT64_C(100000);
    return ns > tp->slot_ns ? ns : tp->slot_ns;
}

/* Obey flow control; false if it ends the message. */
static bool obey(struct isotp *tp)
{
    tp->has_flow = false;
    if ((tp->flow[0] & 0x0F) == OVERFLOW_) {
        stop_sending(tp);
        return false;
    }
    if (tp->sending == SENDING_NOTHING)
        return true;
    if ((tp->flow[0] & 0x0F) == WAIT) {
        if (tp->waits >= MOST_WAITS) {
            stop_sending(tp);
        } else {
            tp->waits++;
            tp->sending = AWAITING_FLOW;
            start(&tp->flow_awaited, tp->now_ns, N_BS_NS);
        }
    } else if (!is_over(&tp->flow_awaited, tp->now_ns)) {
        tp->waits = 0;
        tp->flow_awaited.runs = false;
        tp->separation.length_ns = separation_ns(tp, tp->flow[2]);
        tp->block = tp->flow[1];
        if (tp->sending == AWAITING_FLOW) {
            tp->blocks_sent = 0;
            start(&tp->separation, tp->now_ns, tp->separation.length_ns);
        }
        tp->sending = SENDING_REST;
    }
    return true;
}

static void send_begin(struct isotp *tp)
{
    const struct message *message = &tp->responses[tp->response_first];
    uint8_t *frame = new_frame(tp);
    if (message->size <= CAN_BYTES - 1) {
        frame[0] = (uint8_t)message->size;
        memcpy(frame + 1, message->at, message->size);
        tp->sending = SENDING_REST; /* until now */
        stop_sending(tp);
        return;
    }
    frame[0] = (uint8_t)(FIRST << 4 | message->size >> 8);
    frame[1] = (uint8_t)message->size;
    memcpy(frame + 2, message->at, FIRST_BYTES);
    tp->sent_bytes = FIRST_BYTES;
    tp->sequence = 1;
    tp->sending = AWAITING_FLOW;
    start(&tp->flow_awaited, tp->now_ns, N_BS_NS);
}

/* Send a consecutive frame; whether flow control is awaited then. */
static bool send_rest(struct isotp *tp)
{
    const struct message *message = &tp->responses[tp->response_first];
    size_t left = message->size - tp->sent_bytes;
    size_t size = left < CONSECUTIVE_BYTES ? left : CONSECUTIVE_BYTES;
    uint8_t *frame = new_frame(tp);
    frame[0] = (uint8_t)(CONSECUTIVE << 4 | tp->sequence);
    memcpy(frame + 1, message->at + tp->sent_bytes, size);
    tp->sent_bytes += size;
    tp->sequence = (tp->sequence + 1) & 0x0F;
    start(&tp->separation, tp->now_ns, tp->separation.length_ns);
    tp->blocks_sent++;
    if (tp->sent_bytes == message->size) {
        stop_sending(tp);
    } else if (tp->block != 0 && tp->blocks_sent >= tp->block) {
        tp->sending = AWAITING_FLOW;
        start(&tp->flow_awaited, tp->now_ns, N_BS_NS);
        return true;
    }
    return false;
}

/* Send all that can be sent now; whether to receive at once. */
static bool send_all(struct isotp *tp)
{
    for (;;) {
        if (tp->flow_due) {
            uint8_t *frame = new_frame(tp);
            tp->flow_due = false;
            if (!tp->flow_overflow)
                start(&tp->consecutive, tp->now_ns, N_CR_NS);
            frame[0] = (uint8_t)(FLOW << 4 | (tp->flow_overflow ? OVERFLOW_ : GO_ON));
            frame[1] = BLOCK_SIZE;
            frame[2] = ST_MIN_MS;
            return true;
        }
        if (tp->has_flow && !obey(tp))
            return false;
        if (is_over(&tp->flow_awaited, tp->now_ns))
            stop_sending(tp);
        if (tp->sending == SENDING_NOTHING && tp->response_count > 0)
            send_begin(tp);
        else if (tp->sending == SENDING_REST && is_over(&tp->separation, tp->now_ns)) {
            if (send_rest(tp))
                return true;
        } else
            return false;
    }
}

static void process(struct isotp *tp, bool receives)
{
    bool goes_on = true;
    while (goes_on) {
        bool sends_first =
            tp->response_count > 0 && !tp->is_receiving && tp->sending == SENDING_NOTHING;
        if (receives && !sends_first)
            receive_all(tp);
        goes_on = send_all(tp) || sends_first;
    }
}

void isotp_begin(struct isotp *tp, int64_t now_ns)
{
    size_t begin = tp->fed, fresh = tp->waiting_count - tp->fed;
    tp->now_ns = now_ns;
    tp->fed += fresh < FED_FRAMES ? fresh : FED_FRAMES;
    for (size_t k = begin; k < tp->fed; k++) {
        const struct can_data *frame = &tp->waiting[(tp->waiting_first + k) % RING];
        if (frame->can_id == FUNCTIONAL_ID && is_single(frame) && tp->functional_count < REQUESTS)
            keep(queued(tp->functional, &tp->functional_first, &tp->functional_count),
                 frame->at + 1, frame->at[0]);
    }
    process(tp, true);
}

static const struct message *taken(struct message *queue, size_t *first, size_t *count)
{
    const struct message *message = &queue[*first];
    if (*count == 0)
        return NULL;
    *first = (*first + 1) % REQUESTS;
    --*count;
    return message;
}

const struct message *isotp_functional(struct isotp *tp)
{
    return taken(tp->functional, &tp->functional_first, &tp->functional_count);
}

const struct message *isotp_request(struct isotp *tp)
{
    return taken(tp->requests, &tp->request_first, &tp->request_count);
}

int64_t isotp_sending_ns(const struct isotp *tp, size_t size)
{
    size_t following = size > FIRST_BYTES ? size - FIRST_BYTES : 0;
    return (int64_t)((following + CONSECUTIVE_BYTES - 1) / CONSECUTIVE_BYTES) * tp->slot_ns;
}

bool isotp_send(struct isotp *tp, const uint8_t *response, size_t size)
{
    if (tp->response_count == RESPONSES)
        return false;
    keep(&tp->responses[(tp->response_first + tp->response_count++) % RESPONSES], response, size);
    return true;
}

size_t isotp_end(struct isotp *tp, uint8_t frames[SLOTS][8])
{
    int64_t begin_ns = tp->now_ns;
    size_t count;
    process(tp, false);
    for (int slot = 1; slot < SLOTS; slot++) {
        if (tp->out_count >= SLOTS || !is_transmitting(tp))
            break;
        tp->now_ns = begin_ns + slot * tp->slot_ns;
        process(tp, false);
    }
    count = tp->out_count < SLOTS ? tp->out_count : SLOTS;
    memcpy(frames, tp->out, count * sizeof tp->out[0]);
    tp->out_count -= count;
    memmove(tp->out, tp->out + count, tp->out_count * sizeof tp->out[0]);
    return count;
}
