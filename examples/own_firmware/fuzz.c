/*
 * The intake and the step on random frames, most right but for a bit, a counter or an order.
 *
 * Calm epochs come between, in which all is right, so that every mode is reached.
 *
 *     fuzz FRAMES
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "contract.h"
#include "firmware.h"
#include "rrins.h"

enum { MOST = 40, CALM = 400, WILD = 30, CALL_AT = 150 };

static uint64_t state = UINT64_C(88172645463325252);

static uint64_t drawn(void) /* xorshift: Marsaglia (2003) */
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state;
}

static void set_up(struct setup *setup)
{
    memset(setup, 0, sizeof *setup);
    setup->rate_hz = 200;
    setup->latitude = 0.7;
    setup->alignment_s = 0.1;
    setup->bridge_s = 0.1;
    setup->axis_silence_s = 1.0;
    setup->axis_acceleration_dps2 = 10.0;
    setup->follow_tolerance_deg = 5.0;
    setup->turn_rate_dps = 2.0;
    setup->stand_s = 1.0;
    setup->positions = 1;
    setup->position[0] = (struct position){INNER, 180.0};
    setup->gyros.count = setup->accelerometers.count = 3;
    for (int k = 0; k < 3; k++) {
        setup->gyros.H[k][k] = setup->accelerometers.H[k][k] = 1.0;
        setup->gyros.weight[k] = setup->accelerometers.weight[k] = 1.0;
    }
    matrix_of_euler(setup->C_b_n, 0.0, 0.0, 0.0);
}

/* A frame of the contract with random contents, right protection, and the epoch's counter or not. */
static void make(struct rrins_frame *frame, int64_t epoch)
{
    static const struct {
        uint32_t id;
        uint16_t data_id;
    } kinds[] = {
        {RRINS_SYNC_FRAME_ID, RRINS_SYNC_E2E_DATA_ID},
        {RRINS_MODE_COMMAND_FRAME_ID, RRINS_MODE_COMMAND_E2E_DATA_ID},
        {RRINS_SENSOR_1_FRAME_ID, RRINS_SENSOR_1_E2E_DATA_ID},
        {RRINS_SENSOR_2_FRAME_ID, RRINS_SENSOR_2_E2E_DATA_ID},
        {RRINS_SENSOR_3_FRAME_ID, RRINS_SENSOR_3_E2E_DATA_ID},
        {RRINS_AXIS_INNER_STATUS_FRAME_ID, RRINS_AXIS_INNER_STATUS_E2E_DATA_ID},
        {RRINS_AXIS_OUTER_STATUS_FRAME_ID, RRINS_AXIS_OUTER_STATUS_E2E_DATA_ID},
        {RRINS_ALTIMETER_FRAME_ID, RRINS_ALTIMETER_E2E_DATA_ID},
    };
    uint64_t word = drawn(), choice = drawn();
    size_t k = choice % (sizeof kinds / sizeof *kinds);
    memset(frame, 0, sizeof *frame);
    memcpy(frame->data, &word, sizeof frame->data);
    frame->can_id = kinds[k].id;
    if (k == 0 && choice >> 8 & 1) { /* a SYNC of about now */
        struct rrins_sync_t sync = {0};
        sync.epoch = (uint32_t)((epoch + (int64_t)(choice >> 9 & 3) - 1) & 0xFFFFFF);
        rrins_sync_pack(frame->data, &sync, sizeof frame->data);
    }
    if (k == 1) { /* SHUTDOWN would be the end of it */
        struct rrins_mode_command_t command = {0};
        command.mode_request = (uint8_t)(choice >> 8 & 3) + 1u;
        rrins_mode_command_pack(frame->data, &command, sizeof frame->data);
    }
    e2e_protect(frame, kinds[k].data_id, choice >> 16 & 7 ? (uint64_t)epoch : choice >> 20);
    if ((choice >> 40 & 15) == 0)
        frame->data[choice >> 44 & 7] ^= (uint8_t)(1u << (choice >> 48 & 7));
    if ((choice >> 52 & 31) == 0)
        frame->length = (uint8_t)(choice >> 57 & 15);
    if ((choice >> 57 & 31) == 1)
        frame->can_id = (uint32_t)drawn();
}

static size_t protected_frame(struct rrins_frame *frame, uint32_t id, uint16_t data_id,
                              int64_t counter)
{
    frame->can_id = id;
    e2e_protect(frame, data_id, (uint64_t)counter);
    return 1;
}

/* All frames of an epoch at standstill; the operator asks for STANDBY, later for navigation. */
static size_t make_calm(struct rrins_frame *frames, int64_t epoch, int since)
{
    static const uint16_t data_ids[] = {RRINS_SENSOR_1_E2E_DATA_ID, RRINS_SENSOR_2_E2E_DATA_ID,
                                        RRINS_SENSOR_3_E2E_DATA_ID};
    struct rrins_sync_t sync = {0};
    struct rrins_mode_command_t command = {0};
    struct rrins_sensor_1_t sensor = {0};
    struct rrins_axis_inner_status_t axis = {0};
    size_t count = 0;
    memset(frames, 0, MOST * sizeof *frames);
    sync.epoch = (uint32_t)(epoch & 0xFFFFFF);
    rrins_sync_pack(frames[0].data, &sync, sizeof frames->data);
    count += protected_frame(frames, RRINS_SYNC_FRAME_ID, RRINS_SYNC_E2E_DATA_ID, epoch);
    command.mode_request = since < CALL_AT
                               ? RRINS_MODE_COMMAND_MODE_REQUEST_STANDBY_CHOICE
                               : RRINS_MODE_COMMAND_MODE_REQUEST_NAVIGATE_ROTATING_CHOICE;
    rrins_mode_command_pack(frames[count].data, &command, sizeof frames->data);
    count += protected_frame(&frames[count], RRINS_MODE_COMMAND_FRAME_ID,
                             RRINS_MODE_COMMAND_E2E_DATA_ID, since);
    for (uint32_t k = 0; k < 3; k++) {
        sensor.accelerometer_dv = k == 2 ? rrins_sensor_1_accelerometer_dv_encode(0.049) : 0;
        rrins_sensor_1_pack(frames[count].data, &sensor, sizeof frames->data);
        count += protected_frame(&frames[count], RRINS_SENSOR_1_FRAME_ID + k, data_ids[k], epoch);
    }
    axis.state = RRINS_AXIS_INNER_STATUS_STATE_HOLDING_CHOICE;
    for (int k = 0; k < AXES; k++) {
        rrins_axis_inner_status_pack(frames[count].data, &axis, sizeof frames->data);
        count += protected_frame(
            &frames[count],
            k == INNER ? RRINS_AXIS_INNER_STATUS_FRAME_ID : RRINS_AXIS_OUTER_STATUS_FRAME_ID,
            k == INNER ? RRINS_AXIS_INNER_STATUS_E2E_DATA_ID : RRINS_AXIS_OUTER_STATUS_E2E_DATA_ID,
            epoch);
    }
    return count;
}

int main(int count, char **words)
{
    static struct firmware firmware;
    static struct rrins_frame inbox[MOST], outbox[OUTBOX];
    long left = count > 1 ? strtol(words[1], NULL, 10) : 1000000, navigated = 0;
    struct setup setup;
    set_up(&setup);
    firmware_power_on(&firmware, &setup);
    for (int since = 0; left > 0; since = (since + 1) % (CALM + WILD)) {
        size_t frames, consumed, sent;
        if (since < CALM) {
            frames = make_calm(inbox, firmware.epoch + 1, since);
        } else {
            frames = (size_t)(drawn() % MOST);
            left -= (long)frames;
            for (size_t k = 0; k < frames; k++)
                make(&inbox[k], firmware.epoch + 1);
        }
        firmware.is_whole = drawn() & 1;
        firmware.sync_arrival_ns += (int64_t)(drawn() % 10000000);
        sent = firmware_step(&firmware, inbox, frames, &consumed, outbox);
        if (consumed > frames || sent < 2 || sent > OUTBOX) {
            printf("epoch %lld: %zu of %zu frames taken, %zu sent\n", (long long)firmware.epoch,
                   consumed, frames, sent);
            return 1;
        }
        navigated += firmware_navigates(&firmware);
    }
    printf("%ld epochs navigated, %lld wrong CRC, %lld wrong counter, mode %u\n", navigated,
           (long long)firmware.faults.crc_errors, (long long)firmware.faults.counter_errors,
           firmware.mode);
    return 0;
}
