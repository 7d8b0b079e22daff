/* Frames out: axis commands every epoch, the rest at the cycle times of the DBC. */
#include "firmware.h"

#include <math.h>
#include <string.h>

#include "contract.h"
#include "rrins.h"

static double limited(double value, double low, double high)
{
    return value > low ? (value < high ? value : high) : low; /* NaN is the lowest */
}

/* The raw value of a signal, limited to its range. */
#define RAW(signal, SIGNAL, value) \
    rrins_##signal##_encode(limited((value), RRINS_##SIGNAL##_LOW, RRINS_##SIGNAL##_HIGH))

static double degrees(double angle)
{
    return angle * 180.0 / PI;
}

static bool is_due(const struct firmware *fw, unsigned cycle_ms)
{
    int64_t every = (int64_t)cycle_ms * 1000000 / fw->period_ns;
    return fw->epoch % (every > 1 ? every : 1) == 0;
}

/* The epoch as the field of a message holds it: modulo one more than its largest value. */
static uint16_t epoch_field(const struct firmware *fw, double highest)
{
    return (uint16_t)(fw->epoch % (int64_t)(highest + 1.0));
}

static void start(struct rrins_frame *frame, uint32_t id)
{
    memset(frame, 0, sizeof *frame);
    frame->can_id = id;
}

void heartbeat(struct firmware *fw, struct rrins_frame *frame)
{
    struct rrins_heartbeat_firmware_t beat = {0};
    beat.uptime = RAW(heartbeat_firmware_uptime, HEARTBEAT_FIRMWARE_UPTIME,
                      (double)fw->steps * (double)fw->period_ns * 1e-9);
    beat.began_late = fw->clock.began_late;
    start(frame, RRINS_HEARTBEAT_FIRMWARE_FRAME_ID);
    rrins_heartbeat_firmware_pack(frame->data, &beat, sizeof frame->data);
    e2e_protect(frame, RRINS_HEARTBEAT_FIRMWARE_E2E_DATA_ID, fw->heartbeats++);
}

static void status(struct firmware *fw, struct rrins_frame *frame)
{
    const struct scheme *scheme = &fw->scheme;
    struct rrins_firmware_status_t out = {0};
    out.mode = (uint8_t)fw->mode;
    out.fault = (uint8_t)fw->fault;
    if (scheme->running && !scheme->homing)
        out.scheme_position = (uint8_t)(scheme->position + 1);
    out.scheme_cycle = (uint16_t)scheme->cycle;
    out.load_percent = RAW(firmware_status_load_percent, FIRMWARE_STATUS_LOAD_PERCENT,
                           fw->load_percent);
    out.axis_inner_not_following = scheme->not_following[INNER];
    out.axis_outer_not_following = scheme->not_following[OUTER];
    out.sync_lost = fw->clock.lost;
    for (unsigned both = fw->intake.gyro_valid & fw->intake.accelerometer_valid; both; both >>= 1)
        out.usable_sensors = (uint8_t)(out.usable_sensors + (both & 1u));
    out.clock_error_ppm = RAW(firmware_status_clock_error_ppm, FIRMWARE_STATUS_CLOCK_ERROR_PPM,
                              clock_error_ppm(&fw->clock, fw->period_ns));
    start(frame, RRINS_FIRMWARE_STATUS_FRAME_ID);
    rrins_firmware_status_pack(frame->data, &out, sizeof frame->data);
    e2e_protect(frame, RRINS_FIRMWARE_STATUS_E2E_DATA_ID, fw->transmissions);
}

static void fault_counters(struct firmware *fw, struct rrins_frame *frame)
{
    const struct counters *faults = &fw->faults;
    struct rrins_firmware_faults_t out = {0};
    out.crc_errors = RAW(firmware_faults_crc_errors, FIRMWARE_FAULTS_CRC_ERRORS,
                          (double)faults->crc_errors);
    out.counter_errors = RAW(firmware_faults_counter_errors, FIRMWARE_FAULTS_COUNTER_ERRORS,
                          (double)faults->counter_errors);
    out.missing_frames = RAW(firmware_faults_missing_frames, FIRMWARE_FAULTS_MISSING_FRAMES,
                          (double)faults->missing_frames);
    out.bridged_epochs = RAW(firmware_faults_bridged_epochs, FIRMWARE_FAULTS_BRIDGED_EPOCHS,
                          (double)faults->bridged_epochs);
    out.overruns = RAW(firmware_faults_overruns, FIRMWARE_FAULTS_OVERRUNS,
                          (double)faults->overruns);
    start(frame, RRINS_FIRMWARE_FAULTS_FRAME_ID);
    rrins_firmware_faults_pack(frame->data, &out, sizeof frame->data);
    e2e_protect(frame, RRINS_FIRMWARE_FAULTS_E2E_DATA_ID, fw->transmissions);
}

static void position(struct firmware *fw, struct rrins_frame *frame)
{
    struct rrins_nav_latitude_t north = {0};
    struct rrins_nav_longitude_t east = {0};
    uint64_t counter = fw->navigation_transmissions;
    north.latitude_deg = RAW(nav_latitude_latitude_deg, NAV_LATITUDE_LATITUDE_DEG,
                             degrees(fw->ins.latitude));
    north.epoch = epoch_field(fw, RRINS_NAV_LATITUDE_EPOCH_HIGH);
    start(frame, RRINS_NAV_LATITUDE_FRAME_ID);
    rrins_nav_latitude_pack(frame->data, &north, sizeof frame->data);
    e2e_protect(frame, RRINS_NAV_LATITUDE_E2E_DATA_ID, counter);
    east.longitude_deg = RAW(nav_longitude_longitude_deg, NAV_LONGITUDE_LONGITUDE_DEG,
                             degrees(fw->ins.longitude));
    east.epoch = epoch_field(fw, RRINS_NAV_LONGITUDE_EPOCH_HIGH);
    start(frame + 1, RRINS_NAV_LONGITUDE_FRAME_ID);
    rrins_nav_longitude_pack(frame[1].data, &east, sizeof frame->data);
    e2e_protect(frame + 1, RRINS_NAV_LONGITUDE_E2E_DATA_ID, counter);
}

static void motion(struct firmware *fw, struct rrins_frame *frame)
{
    struct rrins_nav_velocity_t velocity = {0};
    struct rrins_nav_height_t height = {0};
    uint64_t counter = fw->navigation_transmissions;
    velocity.velocity_east = RAW(nav_velocity_velocity_east, NAV_VELOCITY_VELOCITY_EAST,
                                 fw->ins.velocity[0]);
    velocity.velocity_north = RAW(nav_velocity_velocity_north, NAV_VELOCITY_VELOCITY_NORTH,
                                  fw->ins.velocity[1]);
    start(frame, RRINS_NAV_VELOCITY_FRAME_ID);
    rrins_nav_velocity_pack(frame->data, &velocity, sizeof frame->data);
    e2e_protect(frame, RRINS_NAV_VELOCITY_E2E_DATA_ID, counter);
    height.height = RAW(nav_height_height, NAV_HEIGHT_HEIGHT, fw->ins.height);
    height.velocity_up = RAW(nav_height_velocity_up, NAV_HEIGHT_VELOCITY_UP, fw->ins.velocity[2]);
    start(frame + 1, RRINS_NAV_HEIGHT_FRAME_ID);
    rrins_nav_height_pack(frame[1].data, &height, sizeof frame->data);
    e2e_protect(frame + 1, RRINS_NAV_HEIGHT_E2E_DATA_ID, counter);
}

/* The body's attitude, through the table: C_b_n = C_s_n C_s_b^T */
static void attitude(struct firmware *fw, struct rrins_frame *frame)
{
    struct rrins_nav_attitude_t out = {0};
    double C[3][3], roll, pitch, heading;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            C[i][j] = fw->ins.C_s_n[i][0] * fw->C_s_b[j][0] +
                      fw->ins.C_s_n[i][1] * fw->C_s_b[j][1] +
                      fw->ins.C_s_n[i][2] * fw->C_s_b[j][2];
    euler_of_matrix(C, &roll, &pitch, &heading);
    out.roll_deg = RAW(nav_attitude_roll_deg, NAV_ATTITUDE_ROLL_DEG, degrees(roll));
    out.pitch_deg = RAW(nav_attitude_pitch_deg, NAV_ATTITUDE_PITCH_DEG, degrees(pitch));
    out.heading_deg = RAW(nav_attitude_heading_deg, NAV_ATTITUDE_HEADING_DEG, degrees(heading));
    start(frame, RRINS_NAV_ATTITUDE_FRAME_ID);
    rrins_nav_attitude_pack(frame->data, &out, sizeof frame->data);
    e2e_protect(frame, RRINS_NAV_ATTITUDE_E2E_DATA_ID, fw->navigation_transmissions);
}

static void axis_command(struct firmware *fw, struct rrins_frame *frame, int axis)
{
    struct rrins_axis_inner_command_t out = {0}; /* both axes have one layout */
    double step = rrins_axis_inner_command_target_angle_deg_decode(1);
    out.command = (uint8_t)fw->scheme.command[axis];
    /* Targets add up over the turns; the field wraps. */
    out.target_angle_deg = (int32_t)(uint32_t)(int64_t)rint(fw->scheme.target_deg[axis] / step);
    out.rate_limit_dps = RAW(axis_inner_command_rate_limit_dps,
                             AXIS_INNER_COMMAND_RATE_LIMIT_DPS, fw->setup.turn_rate_dps);
    start(frame, axis == INNER ? RRINS_AXIS_INNER_COMMAND_FRAME_ID
                               : RRINS_AXIS_OUTER_COMMAND_FRAME_ID);
    rrins_axis_inner_command_pack(frame->data, &out, sizeof frame->data);
    e2e_protect(frame,
                axis == INNER ? RRINS_AXIS_INNER_COMMAND_E2E_DATA_ID
                              : RRINS_AXIS_OUTER_COMMAND_E2E_DATA_ID,
                (uint64_t)fw->epoch);
}

size_t transmit(struct firmware *fw, struct rrins_frame *outbox)
{
    size_t count = 0;
    if (is_due(fw, RRINS_HEARTBEAT_FIRMWARE_CYCLE_TIME_MS))
        heartbeat(fw, &outbox[count++]);
    if (is_due(fw, RRINS_FIRMWARE_STATUS_CYCLE_TIME_MS)) {
        status(fw, &outbox[count]);
        fault_counters(fw, &outbox[count + 1]);
        fw->transmissions++;
        count += 2;
    }
    if (firmware_navigates(fw) && is_due(fw, RRINS_NAV_LATITUDE_CYCLE_TIME_MS)) {
        position(fw, &outbox[count]);
        motion(fw, &outbox[count + 2]);
        attitude(fw, &outbox[count + 4]);
        fw->navigation_transmissions++;
        count += 5;
    }
    axis_command(fw, &outbox[count], INNER);
    axis_command(fw, &outbox[count + 1], OUTER); /* the last: it closes the epoch */
    return count + 2;
}
