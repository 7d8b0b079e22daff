#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FMU_WITH_TABLES
#include "fmu.h"

enum { INBOX = FMU_BYTES / 16, CAN_TRANSMIT = 0x10, PAYLOAD = 8, STANDARD_FRAME = 24 };
enum { EFF = 31, RTR = 30 }; /* bits of an identifier */

/* "CAN Transmit" of FMI-LS-BUS. */
#pragma pack(push, 1)
struct transmit {
    uint32_t operation, length, id;
    uint8_t extended, remote;
    uint16_t data_length;
    uint8_t data[PAYLOAD];
};
#pragma pack(pop)

static bool fail(struct fmu *fmu, const char *reason)
{
    fmu->reason = reason;
    return false;
}

/* Read frames; their number, negative if the bytes are not operations of a bus. */
static int32_t unpack(const uint8_t *bytes, size_t size, struct rrins_frame *frames)
{
    const size_t head = offsetof(struct transmit, data);
    int32_t count = 0;
    for (size_t at = 0; at < size;) {
        struct transmit one = {0};
        size_t left = size - at;
        memcpy(&one, bytes + at, left < sizeof one ? left : sizeof one);
        if (left < offsetof(struct transmit, id) || one.length < offsetof(struct transmit, id) ||
            one.length > left)
            return -1;
        at += one.length;
        if (one.operation != CAN_TRANSMIT)
            continue;
        if (one.length < head || one.data_length > PAYLOAD || one.length != head + one.data_length)
            return -1;
        memset(&frames[count], 0, sizeof *frames);
        frames[count].can_id = one.id | (uint32_t)(one.extended != 0) << EFF |
                               (uint32_t)(one.remote != 0) << RTR;
        frames[count].length = (uint8_t)one.data_length;
        memcpy(frames[count++].data, one.data, one.data_length);
    }
    return count;
}

static size_t pack(const struct rrins_frame *frames, int32_t count, uint8_t *bytes)
{
    size_t size = 0;
    for (int32_t k = 0; k < count; k++) {
        struct transmit one = {.operation = CAN_TRANSMIT, .data_length = frames[k].length};
        one.length = (uint32_t)offsetof(struct transmit, data) + frames[k].length;
        one.id = frames[k].can_id & 0x1FFFFFFF;
        one.extended = frames[k].can_id >> EFF & 1;
        one.remote = frames[k].can_id >> RTR & 1;
        memcpy(one.data, frames[k].data, PAYLOAD);
        memcpy(bytes + size, &one, one.length);
        size += one.length;
    }
    return size;
}

#ifdef FMU_IS_HARDWARE

extern const double rrins_motion[];
extern const int32_t rrins_motion_pieces;

static void power_on(FMU_MEMORY *memory)
{
    rrins_hardware_power_on(memory);
}

/* A number that differs from those of other seeds and places: a step of SplitMix64. */
static uint64_t mixed(uint64_t seed, uint64_t place)
{
    uint64_t word = (seed << 16 | place) * 0x9E3779B97F4A7C15;
    word = (word ^ word >> 30) * 0xBF58476D1CE4E5B9;
    word = (word ^ word >> 27) * 0x94D049BB133111EB;
    return word ^ word >> 31;
}

static void draw_other_noise(struct fmu_state *now)
{
    for (size_t k = 0; k < FMU_NOISES; k++) {
        uint64_t word = mixed((uint64_t)(int64_t)now->parameters[0], k);
        memcpy((uint8_t *)&now->memory + noises[k], &word, sizeof word);
    }
}

static int32_t step(struct fmu_state *now, const struct rrins_frame *inbox, int32_t count,
                    struct rrins_frame *outbox)
{
    now->steps++;
    return rrins_hardware_step(&now->memory, rrins_motion, rrins_motion_pieces, rrins_contract,
                               inbox, count, outbox);
}

#else

static void power_on(FMU_MEMORY *memory)
{
    rrins_firmware_power_on(memory);
}

static void draw_other_noise(struct fmu_state *now)
{
    (void)now;
}

/* What a clock shows after a time if it runs fast by so much. */
static int64_t own_clock_ns(int64_t time_ns, double error_ppm)
{
    const int64_t second_ns = 1000000000;
    int64_t error_ppb = (int64_t)rint(error_ppm * 1000.0);
    int64_t rest = time_ns % second_ns * error_ppb;
    return time_ns + time_ns / second_ns * error_ppb + (rest - (rest < 0) * (second_ns - 1)) / second_ns;
}

/* The computer is off until the first frames come. */
static int32_t step(struct fmu_state *now, const struct rrins_frame *inbox, int32_t count,
                    struct rrins_frame *outbox)
{
    FMU_MEMORY *ram = &now->memory;
    if (now->steps == 0 && count == 0)
        return 0;
    ram->clock.sync_arrival_ns =
        own_clock_ns(now->steps++ * ram->parameters.period_ns, now->parameters[0]);
    ram->clock.is_whole = true;
    return rrins_firmware_step(ram, rrins_contract, inbox, count, outbox);
}

#endif

struct fmu *fmu_new(const char *token)
{
    struct fmu *fmu = NULL;
    if (token != NULL && strcmp(token, FMU_TOKEN) == 0)
        fmu = calloc(1, sizeof *fmu);
    if (fmu == NULL)
        return NULL;
    fmu->reason = "not as the model description says";
    fmu_reset(fmu);
    return fmu;
}

void fmu_reset(struct fmu *fmu)
{
    memset(&fmu->now, 0, sizeof fmu->now);
    memset(fmu->address, 0, sizeof fmu->address);
    memcpy(fmu->now.parameters, starts, sizeof starts);
    power_on(&fmu->now.memory);
}

bool fmu_begin(struct fmu *fmu)
{
    struct fmu_state *now = &fmu->now;
    uint8_t *memory = (uint8_t *)&now->memory;
    bool is_changed[FMU_PARAMETERS];
    for (size_t k = 0; k < FMU_PARAMETERS; k++)
        is_changed[k] = now->parameters[k] != starts[k];
    power_on(&now->memory);
    if (is_changed[0])
        draw_other_noise(now);
    for (const struct fmu_effect *first = effects, *next; first->parameter >= 0; first = next) {
        double value = first->base;
        bool is_affected = false;
        for (next = first; next->parameter >= 0 && next->offset == first->offset; next++) {
            value += next->slope * now->parameters[next->parameter];
            is_affected |= is_changed[next->parameter];
        }
        if (is_affected) /* what nobody has changed keeps its last bit, too */
            memcpy(memory + first->offset, &value, sizeof value);
    }
    for (const struct fmu_effect *flag = flags; flag->parameter >= 0; flag++)
        memory[flag->offset] |= is_changed[flag->parameter];
    return true;
}

bool fmu_step(struct fmu *fmu, double time, double length)
{
    struct fmu_state *now = &fmu->now;
    struct rrins_frame inbox[INBOX], outbox[FMU_OUTBOX];
    int32_t received, sent;
    if (fabs(length - FMU_PERIOD_S) > 1e-6 * FMU_PERIOD_S)
        return fail(fmu, "a step is an epoch: take the step size of the model description");
    if (fmu->address[FMU_SIZE] > 0) {
        uintptr_t at = (uintptr_t)((uint64_t)(uint32_t)fmu->address[FMU_HIGH] << 32 |
                                   (uint32_t)fmu->address[FMU_LOW]);
        if (!fmu_set_received(fmu, (const uint8_t *)at, (size_t)fmu->address[FMU_SIZE]))
            return false;
        fmu->address[FMU_SIZE] = 0;
    }
    received = unpack(now->received, now->received_size, inbox);
    if (received < 0)
        return fail(fmu, "the bytes received are not operations of FMI-LS-BUS");
    sent = step(now, inbox, received, outbox);
    if (sent < 0)
        return fail(fmu, "the step has failed");
    now->received_size = 0; /* frames come once */
    now->sent_size = pack(outbox, sent, now->sent[now->steps & 1]);
    now->time = time + length;
    return true;
}

bool fmu_get(struct fmu *fmu, uint32_t reference, double *value)
{
    if (reference == FMU_TIME) {
        *value = fmu->now.time;
    } else if (reference >= FMU_PARAMETER && reference < FMU_END) {
        *value = fmu->now.parameters[reference - FMU_PARAMETER];
    } else if (reference >= FMU_OUTPUT && reference < FMU_PARAMETER &&
               !outputs[reference - FMU_OUTPUT].is_integer) {
        memcpy(value, (uint8_t *)&fmu->now.memory + outputs[reference - FMU_OUTPUT].offset,
               sizeof *value);
    } else {
        return fail(fmu, "no such number");
    }
    return true;
}

bool fmu_get_integer(struct fmu *fmu, uint32_t reference, int64_t *value)
{
    if (reference >= FMU_PARAMETER && reference < FMU_END) {
        *value = (int64_t)fmu->now.parameters[reference - FMU_PARAMETER];
    } else if (reference >= FMU_OUTPUT && reference < FMU_PARAMETER &&
               outputs[reference - FMU_OUTPUT].is_integer) {
        memcpy(value, (uint8_t *)&fmu->now.memory + outputs[reference - FMU_OUTPUT].offset,
               sizeof *value);
    } else {
        return fail(fmu, "no such integer");
    }
    return true;
}

bool fmu_set(struct fmu *fmu, uint32_t reference, double value)
{
    if (reference < FMU_PARAMETER || reference >= FMU_END)
        return fail(fmu, "no such parameter");
    fmu->now.parameters[reference - FMU_PARAMETER] = value;
    return true;
}

bool fmu_set_received(struct fmu *fmu, const uint8_t *bytes, size_t size)
{
    if (size > FMU_BYTES)
        return fail(fmu, "more bytes received than fit");
    if (size > 0)
        memcpy(fmu->now.received, bytes, size);
    fmu->now.received_size = size;
    return true;
}

const uint8_t *fmu_sent(const struct fmu *fmu)
{
    return fmu->now.sent[fmu->now.steps & 1];
}

bool fmu_save(struct fmu *fmu, void **state)
{
    if (*state == NULL)
        *state = malloc(sizeof fmu->now);
    if (*state == NULL)
        return fail(fmu, "no memory left");
    memcpy(*state, &fmu->now, sizeof fmu->now);
    return true;
}

bool fmu_load(struct fmu *fmu, const void *state)
{
    if (state == NULL)
        return fail(fmu, "no state");
    memcpy(&fmu->now, state, sizeof fmu->now);
    return true;
}

bool fmu_copy_state(struct fmu *fmu, void *to, const void *from, size_t size)
{
    if (to == NULL || from == NULL || size != sizeof fmu->now)
        return fail(fmu, "not a state of this unit");
    memcpy(to, from, size);
    return true;
}
