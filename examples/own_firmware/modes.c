/* The modes and one epoch of the computer (docs/firmware.md, "Modes"). */
#include "firmware.h"

#include <math.h>
#include <string.h>

#include "rrins.h"

static const double SELF_TEST_GOOD_S = 0.5;
static const double SELF_TEST_LIMIT_S = 10.0;
static const int64_t UNSOUND = 10; /* sound epochs that one without a frame takes back */
static const double STANDS_DPS = 0.05;
static const double STAND_LIMIT_S = 10.0; /* an axis that does not stand by then never will */

enum {
    POWER_ON = RRINS_FIRMWARE_STATUS_MODE_POWER_ON_CHOICE,
    SELF_TEST = RRINS_FIRMWARE_STATUS_MODE_SELF_TEST_CHOICE,
    STANDBY = RRINS_FIRMWARE_STATUS_MODE_STANDBY_CHOICE,
    ALIGNMENT = RRINS_FIRMWARE_STATUS_MODE_ALIGNMENT_CHOICE,
    STRAPDOWN = RRINS_FIRMWARE_STATUS_MODE_NAVIGATION_STRAPDOWN_CHOICE,
    ROTATING = RRINS_FIRMWARE_STATUS_MODE_NAVIGATION_ROTATING_CHOICE,
    FAULT = RRINS_FIRMWARE_STATUS_MODE_FAULT_CHOICE,
    SHUTDOWN = RRINS_FIRMWARE_STATUS_MODE_SHUTDOWN_CHOICE,

    REQUEST_STANDBY = RRINS_MODE_COMMAND_MODE_REQUEST_STANDBY_CHOICE,
    REQUEST_ALIGN = RRINS_MODE_COMMAND_MODE_REQUEST_ALIGN_CHOICE,
    REQUEST_STRAPDOWN = RRINS_MODE_COMMAND_MODE_REQUEST_NAVIGATE_STRAPDOWN_CHOICE,
    REQUEST_ROTATING = RRINS_MODE_COMMAND_MODE_REQUEST_NAVIGATE_ROTATING_CHOICE,
    REQUEST_SHUTDOWN = RRINS_MODE_COMMAND_MODE_REQUEST_SHUTDOWN_CHOICE,

    AXIS_OFF = RRINS_AXIS_INNER_COMMAND_COMMAND_OFF_CHOICE,
    AXIS_HOLD = RRINS_AXIS_INNER_COMMAND_COMMAND_HOLD_CHOICE,
    AXIS_FAULT = RRINS_AXIS_INNER_STATUS_STATE_FAULT_CHOICE
};

void firmware_power_on(struct firmware *fw, const struct setup *setup)
{
    memset(fw, 0, sizeof *fw);
    fw->setup = *setup;
    fw->period_ns = INT64_C(1000000000) / setup->rate_hz;
    fw->epoch = -1;
    fw->mode = POWER_ON;
    clock_power_on(&fw->clock, fw->period_ns);
}

bool firmware_navigates(const struct firmware *fw)
{
    return fw->mode == STRAPDOWN || fw->mode == ROTATING;
}

bool firmware_is_shut_down(const struct firmware *fw)
{
    return fw->mode == SHUTDOWN;
}

static double dt_of(const struct firmware *fw)
{
    return (double)fw->period_ns * 1e-9;
}

static void enter(struct firmware *fw, unsigned mode)
{
    unsigned before = fw->mode;
    fw->mode = mode;
    fw->mode_epochs = fw->good_epochs = 0;
    if (mode != FAULT && mode != SHUTDOWN) /* keep the reason readable */
        fw->fault = RRINS_FIRMWARE_STATUS_FAULT_NONE_CHOICE;
    if (mode == ALIGNMENT) {
        alignment_begin(&fw->alignment);
        fw->aligned = false;
    }
    if (mode == ROTATING)
        scheme_start(fw);
    else
        scheme_stop(&fw->scheme, mode == SHUTDOWN ? AXIS_OFF : AXIS_HOLD);
    if ((mode == STRAPDOWN || mode == ROTATING) && before == ALIGNMENT)
        ins_begin(&fw->ins, fw->alignment.C_s_n, &fw->setup);
}

static void fail(struct firmware *fw, unsigned fault)
{
    fw->pending = 0;
    enter(fw, FAULT);
    fw->fault = fault;
}

/* Act once on a request that differs from the one before. */
static void follow_request(struct firmware *fw)
{
    unsigned request = fw->heard_request;
    if (request == fw->request)
        return;
    fw->request = request;
    if (fw->mode == SHUTDOWN)
        return;
    if (request == REQUEST_SHUTDOWN) {
        enter(fw, SHUTDOWN);
    } else if (request == REQUEST_STANDBY) {
        fw->pending = STANDBY;
        if (fw->mode == FAULT)
            enter(fw, SELF_TEST);
        else if (fw->mode != POWER_ON && fw->mode != SELF_TEST)
            enter(fw, STANDBY);
    } else if (fw->mode == FAULT) {
        return;
    } else if (request == REQUEST_ALIGN) {
        fw->pending = ALIGNMENT;
    } else if (request == REQUEST_STRAPDOWN || request == REQUEST_ROTATING) {
        fw->pending = request == REQUEST_ROTATING ? ROTATING : STRAPDOWN;
        if (firmware_navigates(fw) && fw->mode != fw->pending)
            enter(fw, fw->pending);
    }
}

static void self_test(struct firmware *fw)
{
    unsigned gyros = (1u << fw->setup.gyros.count) - 1u;
    unsigned accelerometers = (1u << fw->setup.accelerometers.count) - 1u;
    bool is_sound = fw->clock.seen && (fw->intake.gyro_valid & gyros) == gyros &&
                    (fw->intake.accelerometer_valid & accelerometers) == accelerometers;
    for (int k = 0; k < AXES; k++)
        is_sound = is_sound && fw->axis[k].heard.once && !fw->axis[k].heard.disputed &&
                   fw->axis[k].state != AXIS_FAULT;
    fw->good_epochs = is_sound ? fw->good_epochs + 1 : fw->good_epochs - UNSOUND;
    if (fw->good_epochs < 0)
        fw->good_epochs = 0;
    if ((double)fw->good_epochs * dt_of(fw) >= SELF_TEST_GOOD_S)
        enter(fw, STANDBY);
    else if ((double)fw->mode_epochs * dt_of(fw) >= SELF_TEST_LIMIT_S)
        fail(fw, RRINS_FIRMWARE_STATUS_FAULT_SELF_TEST_FAILED_CHOICE);
}

/* Begin the alignment when one is asked for, once the axes stand. */
static void stand_by(struct firmware *fw)
{
    bool turns = fabs(fw->axis[INNER].rate_dps) > STANDS_DPS ||
                 fabs(fw->axis[OUTER].rate_dps) > STANDS_DPS;
    if (turns && (double)fw->mode_epochs * dt_of(fw) < STAND_LIMIT_S)
        return;
    if (fw->pending >= ALIGNMENT)
        enter(fw, ALIGNMENT);
}

static void align(struct firmware *fw)
{
    struct alignment *alignment = &fw->alignment;
    double needed = fmax(1.0, rint(fw->setup.alignment_s * (double)fw->setup.rate_hz));
    if (!fw->aligned) {
        alignment_add(alignment, fw->dtheta, fw->dv);
        if ((double)alignment->epochs < needed)
            return;
        if (!fw->setup.self_aligned) {
            alignment_given(alignment, fw->setup.C_b_n, fw->C_s_b);
        } else if (!alignment_find(alignment, dt_of(fw),
                                   earth_gravity(fw->setup.latitude, fw->setup.height))) {
            fail(fw, RRINS_FIRMWARE_STATUS_FAULT_ALIGNMENT_FAILED_CHOICE);
            return;
        }
        alignment_apply_held_back(alignment, rrins_sensor_1_gyro_dtheta_decode(1));
        fw->aligned = true;
    }
    if (fw->pending != ALIGNMENT)
        enter(fw, fw->pending);
}

/* Set the reference of the height channel for this epoch. */
static void refer_height(struct firmware *fw)
{
    fw->altimeter_epochs++;
    fw->ins.reference_interval = 0.0;
    if (!fw->setup.altimeter) {
        fw->ins.reference_interval = dt_of(fw);
    } else if (fw->intake.altitude.once && !fw->intake.altitude.disputed) {
        fw->ins.reference_interval = (double)fw->altimeter_epochs * dt_of(fw);
        fw->ins.reference_height = fw->intake.height;
        fw->altimeter_epochs = 0;
    }
}

static void navigate(struct firmware *fw)
{
    double bridge = rint(fw->setup.bridge_s * (double)fw->setup.rate_hz);
    refer_height(fw);
    ins_update(&fw->ins, fw->dtheta, fw->dv, dt_of(fw), fw->setup.height_channel);
    if ((double)fw->faults.consecutive_bridged > bridge)
        fail(fw, RRINS_FIRMWARE_STATUS_FAULT_SENSORS_LOST_CHOICE);
    else if (!ins_is_plausible(&fw->ins))
        fail(fw, RRINS_FIRMWARE_STATUS_FAULT_NAVIGATION_DIVERGED_CHOICE);
}

static void rotate(struct firmware *fw)
{
    if (scheme_watch(fw)) {
        enter(fw, STRAPDOWN);
        scheme_interrupt(fw);
    } else {
        scheme_advance(fw);
    }
}

static void resume(struct firmware *fw)
{
    if (fw->mode != STRAPDOWN || fw->pending != ROTATING || !scheme_wait(fw))
        return;
    fw->mode = ROTATING;
    fw->mode_epochs = 0;
    scheme_resume(fw);
}

static void run_mode(struct firmware *fw)
{
    unsigned mode = fw->mode;
    fw->mode_epochs++;
    if (mode == POWER_ON)
        enter(fw, SELF_TEST);
    else if (mode == SELF_TEST)
        self_test(fw);
    else if (mode == STANDBY)
        stand_by(fw);
    else if (mode == ALIGNMENT)
        align(fw);
    else if (firmware_navigates(fw))
        navigate(fw);
    if (fw->mode == ROTATING && mode == ROTATING)
        rotate(fw);
    else if (fw->scheme.interrupted)
        resume(fw);
}

/* Fuse gyros and accelerometers, or bridge with the increments of the epoch before. */
static void fuse_all(struct firmware *fw)
{
    bool gyros = fuse(&fw->gyro_fusion, &fw->setup.gyros, fw->intake.gyro_valid, fw->intake.gyro,
                      fw->dtheta);
    bool accelerometers = fuse(&fw->accelerometer_fusion, &fw->setup.accelerometers,
                               fw->intake.accelerometer_valid, fw->intake.accelerometer, fw->dv);
    if (gyros && accelerometers) {
        fw->faults.consecutive_bridged = 0;
    } else if (fw->clock.synchronised) {
        fw->faults.bridged_epochs++;
        fw->faults.consecutive_bridged++;
    }
}

size_t firmware_step(struct firmware *fw, const struct rrins_frame *inbox, size_t count,
                     size_t *consumed, struct rrins_frame *outbox)
{
    fw->steps++;
    *consumed = intake_receive(fw, inbox, count);
    intake_close(fw);
    clock_advance(&fw->clock);
    fuse_all(fw);
    gimbal_matrix(fw->C_s_b, fw->axis[INNER].angle_deg * PI / 180.0,
                  fw->axis[OUTER].angle_deg * PI / 180.0);
    follow_request(fw);
    run_mode(fw);
    return transmit(fw, outbox);
}
