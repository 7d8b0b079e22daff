/* Frames in: checks their protection and assembles one epoch (docs/firmware.md, "Frames in"). */
#include "firmware.h"

#include <string.h>

#include "contract.h"
#include "rrins.h"

static const int64_t EPOCH_MODULUS = INT64_C(1) << 24; /* of SYNC */
static const int64_t ADOPT_BEYOND = 200;               /* epochs that SYNC may run ahead or behind */
static const int64_t EARLY_NS = 1000000000;            /* since the hardware's power-on */

enum { GYRO_UNUSABLE = 5, ACCELEROMETER_UNUSABLE = 10 }; /* saturated or absent */

static const uint16_t SENSOR_DATA_IDS[GROUPS] = {
    RRINS_SENSOR_1_E2E_DATA_ID,  RRINS_SENSOR_2_E2E_DATA_ID,  RRINS_SENSOR_3_E2E_DATA_ID,
    RRINS_SENSOR_4_E2E_DATA_ID,  RRINS_SENSOR_5_E2E_DATA_ID,  RRINS_SENSOR_6_E2E_DATA_ID,
    RRINS_SENSOR_7_E2E_DATA_ID,  RRINS_SENSOR_8_E2E_DATA_ID,  RRINS_SENSOR_9_E2E_DATA_ID,
    RRINS_SENSOR_10_E2E_DATA_ID, RRINS_SENSOR_11_E2E_DATA_ID, RRINS_SENSOR_12_E2E_DATA_ID,
    RRINS_SENSOR_13_E2E_DATA_ID, RRINS_SENSOR_14_E2E_DATA_ID, RRINS_SENSOR_15_E2E_DATA_ID,
    RRINS_SENSOR_16_E2E_DATA_ID,
};

static int64_t modulo(int64_t value, int64_t modulus)
{
    int64_t rest = value % modulus;
    return rest < 0 ? rest + modulus : rest;
}

/* Whether a frame is intact, of this epoch, and the first of its kind. */
static bool belongs_here(struct firmware *fw, const struct rrins_frame *frame, uint16_t data_id,
                         struct heard *heard)
{
    if (!e2e_is_intact(frame, data_id)) {
        fw->faults.crc_errors++;
        return false;
    }
    if (e2e_counter(frame) != modulo(fw->epoch, E2E_MODULUS)) {
        fw->faults.counter_errors++;
        return false;
    }
    if (heard->once) { /* one that says something else has another sender: neither is used */
        fw->faults.counter_errors++;
        heard->disputed |= memcmp(heard->data, frame->data, sizeof heard->data) != 0;
        return false;
    }
    heard->once = true;
    memcpy(heard->data, frame->data, sizeof heard->data);
    return true;
}

static void refuse_sync(struct firmware *fw)
{
    fw->faults.counter_errors++;
}

/* Whether a SYNC far from the count continues another one; else keep its epoch. */
static bool continues_jump(struct firmware *fw, int64_t epoch)
{
    struct clock *clock = &fw->clock;
    int64_t expected = clock->far_epoch - 1;
    if (clock->seen)
        return false;
    if (clock->far_epoch > 0 && expected <= epoch && epoch <= expected + 1)
        return true;
    clock->far_epoch = epoch + 1;
    return false;
}

/* Process a SYNC; false when it opens a later epoch and has to wait for the next step. */
static bool receive_sync(struct firmware *fw, const struct rrins_frame *frame)
{
    struct clock *clock = &fw->clock;
    struct rrins_sync_t sync;
    int64_t wraps, whole, ahead;
    if (!e2e_is_intact(frame, RRINS_SYNC_E2E_DATA_ID)) {
        fw->faults.crc_errors++;
        return true;
    }
    rrins_sync_unpack(&sync, frame->data, sizeof frame->data);
    /* The counter, the whole epoch modulo 15, tells how often the 24 bits have wrapped. */
    wraps = modulo((int64_t)e2e_counter(frame) - (int64_t)sync.epoch, E2E_MODULUS);
    whole = (int64_t)sync.epoch + EPOCH_MODULUS * wraps;
    ahead = modulo((int64_t)sync.epoch - fw->epoch, EPOCH_MODULUS);
    if (ahead >= EPOCH_MODULUS / 2)
        ahead -= EPOCH_MODULUS;
    if ((ahead > ADOPT_BEYOND || ahead < -ADOPT_BEYOND) && clock->synchronised) {
        if (!continues_jump(fw, whole)) {
            refuse_sync(fw);
            return true;
        }
        clock->jumps++;
        clock->synchronised = false;
    }
    if (!clock->synchronised) {
        if (clock->jumps == 0)
            clock->began_late = whole * fw->period_ns > EARLY_NS;
        fw->epoch = whole;
        ahead = 0;
    }
    if (ahead > 0) {
        if (fw->is_whole || (clock->seen && ahead > 1)) {
            refuse_sync(fw);
            return true;
        }
        return false;
    }
    if (ahead < 0 || clock->seen) {
        fw->faults.counter_errors++;
        if (ahead == 0)
            return true;
    } else {
        clock->seen = true;
        clock->far_epoch = 0;
    }
    clock_synchronise(clock, fw->sync_arrival_ns, -ahead);
    return true;
}

static void receive_command(struct firmware *fw, const struct rrins_frame *frame)
{
    struct rrins_mode_command_t command;
    unsigned counter;
    if (!e2e_is_intact(frame, RRINS_MODE_COMMAND_E2E_DATA_ID)) {
        fw->faults.crc_errors++;
        return;
    }
    counter = e2e_counter(frame) + 1u;
    if (counter == fw->command_counter) {
        fw->faults.counter_errors++;
        return;
    }
    fw->command_counter = counter;
    rrins_mode_command_unpack(&command, frame->data, sizeof frame->data);
    fw->heard_request = command.mode_request;
}

static void receive_axis(struct firmware *fw, const struct rrins_frame *frame, int number)
{
    struct axis *axis = &fw->axis[number];
    struct rrins_axis_inner_status_t status; /* both axes have one layout */
    uint16_t data_id = number == INNER ? RRINS_AXIS_INNER_STATUS_E2E_DATA_ID
                                       : RRINS_AXIS_OUTER_STATUS_E2E_DATA_ID;
    if (belongs_here(fw, frame, data_id, &axis->heard)) {
        axis->angle_before_deg = axis->angle_deg;
        axis->rate_before_dps = axis->rate_dps;
        axis->state_before = axis->state;
        rrins_axis_inner_status_unpack(&status, frame->data, sizeof frame->data);
        axis->angle_deg =
            rrins_axis_inner_status_encoder_angle_deg_decode(status.encoder_angle_deg);
        axis->rate_dps = rrins_axis_inner_status_encoder_rate_dps_decode(status.encoder_rate_dps);
        axis->state = status.state;
    } else if (axis->heard.disputed) {
        axis->angle_deg = axis->angle_before_deg;
        axis->rate_dps = axis->rate_before_dps;
        axis->state = axis->state_before;
    }
}

static void receive_sensor(struct firmware *fw, const struct rrins_frame *frame, unsigned group)
{
    struct intake *in = &fw->intake;
    struct rrins_sensor_1_t sensor; /* all groups have one layout */
    unsigned bit = 1u << group;
    if (belongs_here(fw, frame, SENSOR_DATA_IDS[group], &in->group[group])) {
        rrins_sensor_1_unpack(&sensor, frame->data, sizeof frame->data);
        in->gyro[group] = rrins_sensor_1_gyro_dtheta_decode(sensor.gyro_dtheta);
        in->accelerometer[group] =
            rrins_sensor_1_accelerometer_dv_decode(sensor.accelerometer_dv);
        if (!(sensor.status & GYRO_UNUSABLE))
            in->gyro_valid |= bit;
        if (!(sensor.status & ACCELEROMETER_UNUSABLE))
            in->accelerometer_valid |= bit;
    } else if (in->group[group].disputed) {
        in->gyro_valid &= ~bit;
        in->accelerometer_valid &= ~bit;
    }
}

static void receive_altitude(struct firmware *fw, const struct rrins_frame *frame)
{
    struct rrins_altimeter_t altimeter;
    if (!belongs_here(fw, frame, RRINS_ALTIMETER_E2E_DATA_ID, &fw->intake.altitude))
        return;
    rrins_altimeter_unpack(&altimeter, frame->data, sizeof frame->data);
    fw->intake.height = rrins_altimeter_height_decode(altimeter.height);
}

static void begin(struct firmware *fw)
{
    struct intake *in = &fw->intake;
    fw->epoch++;
    fw->clock.seen = false;
    if (fw->clock.far_epoch > 0)
        fw->clock.far_epoch++;
    in->gyro_valid = in->accelerometer_valid = 0;
    memset(in->group, 0, sizeof in->group);
    memset(&in->altitude, 0, sizeof in->altitude);
    for (int axis = 0; axis < AXES; axis++)
        memset(&fw->axis[axis].heard, 0, sizeof fw->axis[axis].heard);
}

size_t intake_receive(struct firmware *fw, const struct rrins_frame *inbox, size_t count)
{
    begin(fw);
    for (size_t k = 0; k < count; k++) {
        const struct rrins_frame *frame = &inbox[k];
        uint32_t id = frame->can_id;
        if (id == RRINS_SYNC_FRAME_ID) {
            if (!receive_sync(fw, frame))
                return k;
        } else if (id == RRINS_MODE_COMMAND_FRAME_ID) {
            receive_command(fw, frame);
        } else if (id >= RRINS_SENSOR_1_FRAME_ID && id < RRINS_SENSOR_1_FRAME_ID + GROUPS) {
            receive_sensor(fw, frame, id - RRINS_SENSOR_1_FRAME_ID);
        } else if (id == RRINS_AXIS_INNER_STATUS_FRAME_ID) {
            receive_axis(fw, frame, INNER);
        } else if (id == RRINS_AXIS_OUTER_STATUS_FRAME_ID) {
            receive_axis(fw, frame, OUTER);
        } else if (id == RRINS_ALTIMETER_FRAME_ID) {
            receive_altitude(fw, frame);
        }
    }
    return count;
}

static bool came(const struct heard *heard)
{
    return heard->once && !heard->disputed;
}

/* Close the epoch: count what is missing, once the hardware has been heard. */
void intake_close(struct firmware *fw)
{
    const struct setup *setup = &fw->setup;
    int groups = setup->gyros.count > setup->accelerometers.count ? setup->gyros.count
                                                                  : setup->accelerometers.count;
    if (!fw->clock.synchronised)
        return;
    if (!fw->clock.seen)
        fw->faults.missing_frames++;
    for (int group = 0; group < groups; group++)
        if (!came(&fw->intake.group[group]))
            fw->faults.missing_frames++;
    for (int k = 0; k < AXES; k++) {
        struct axis *axis = &fw->axis[k];
        if (came(&axis->heard)) {
            axis->silent_epochs = 0;
            continue;
        }
        axis->angle_deg += axis->rate_dps * (double)fw->period_ns * 1e-9;
        axis->silent_epochs++;
        fw->faults.missing_frames++;
    }
}
