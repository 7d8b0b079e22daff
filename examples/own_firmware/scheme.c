/* The rotation scheme: commands the axes and watches that they follow (docs/firmware.md). */
#include "firmware.h"

#include <math.h>

#include "rrins.h"

static const double AT_ZERO_DEG = 0.01;
static const double SETTLE_S = 10.0;
static const double FIRST_WAIT_S = 1.0;
static const double FOLLOWED_S = 0.5;

enum {
    TRIES = 8,
    HOLD = RRINS_AXIS_INNER_COMMAND_COMMAND_HOLD_CHOICE,
    POSITION = RRINS_AXIS_INNER_COMMAND_COMMAND_POSITION_CHOICE,
    STANDS = RRINS_AXIS_INNER_STATUS_STATE_HOLDING_CHOICE,
    AXIS_FAULT = RRINS_AXIS_INNER_STATUS_STATE_FAULT_CHOICE
};

/* The angle nearest to `near` that an encoder's frame can mean: it wraps after many turns. */
static double unwrapped(double angle_deg, double near)
{
    double span = rrins_axis_inner_status_encoder_angle_deg_decode(1) * 4294967296.0;
    return angle_deg + span * rint((near - angle_deg) / span);
}

static double seconds_of(const struct firmware *fw, int64_t epochs)
{
    return (double)epochs * (double)fw->period_ns * 1e-9;
}

static int64_t position_epochs(const struct firmware *fw)
{
    const struct setup *setup = &fw->setup;
    double turn = fabs(setup->position[fw->scheme.position].turn_deg);
    double epochs = rint((turn / setup->turn_rate_dps + setup->stand_s) * (double)setup->rate_hz);
    return epochs < 1.0 ? 1 : (int64_t)epochs;
}

/* Command the turn of the current position. */
static void enter(struct firmware *fw)
{
    struct scheme *scheme = &fw->scheme;
    const struct position *position = &fw->setup.position[scheme->position];
    scheme->epochs = scheme->turn_begun = 0;
    for (int axis = 0; axis < AXES; axis++) {
        scheme->start_deg[axis] = scheme->target_deg[axis];
        scheme->command[axis] = POSITION;
    }
    scheme->target_deg[position->axis] += position->turn_deg;
}

void scheme_start(struct firmware *fw)
{
    struct scheme *scheme = &fw->scheme;
    *scheme = (struct scheme){.running = true};
    for (int axis = 0; axis < AXES; axis++) {
        scheme->start_deg[axis] = fw->axis[axis].angle_deg;
        scheme->command[axis] = POSITION;
        if (fabs(fw->axis[axis].angle_deg) > AT_ZERO_DEG)
            scheme->homing = true;
    }
    if (!scheme->homing)
        enter(fw);
}

void scheme_stop(struct scheme *scheme, unsigned command)
{
    scheme->running = scheme->interrupted = false;
    for (int axis = 0; axis < AXES; axis++)
        scheme->command[axis] = command;
}

/* Whether the turn after an interruption is over; then all is well again. */
static bool is_made_up(struct firmware *fw)
{
    struct scheme *scheme = &fw->scheme;
    const struct setup *setup = &fw->setup;
    double turn = 0.0, seconds;
    for (int axis = 0; axis < AXES; axis++)
        turn = fmax(turn, fabs(scheme->target_deg[axis] - scheme->start_deg[axis]));
    seconds = turn / setup->turn_rate_dps + setup->turn_rate_dps / setup->axis_acceleration_dps2 +
              setup->axis_rise_s + FOLLOWED_S;
    if (seconds_of(fw, scheme->epochs - scheme->turn_begun) < seconds)
        return false;
    scheme->tries = 0;
    for (int axis = 0; axis < AXES; axis++)
        scheme->not_following[axis] = false;
    return true;
}

void scheme_advance(struct firmware *fw)
{
    struct scheme *scheme = &fw->scheme;
    scheme->epochs++;
    if (scheme->tries > 0 && !is_made_up(fw))
        return;
    if (scheme->homing) {
        double turn = fmax(fabs(scheme->start_deg[INNER]), fabs(scheme->start_deg[OUTER]));
        if (seconds_of(fw, scheme->epochs) >= turn / fw->setup.turn_rate_dps + SETTLE_S) {
            scheme->homing = false;
            enter(fw);
        }
        return;
    }
    if (scheme->epochs < position_epochs(fw))
        return;
    if (++scheme->position == fw->setup.positions) {
        scheme->position = 0;
        scheme->cycle++;
    }
    enter(fw);
}

void scheme_interrupt(struct firmware *fw)
{
    struct scheme *scheme = &fw->scheme;
    if (scheme->tries >= TRIES)
        return; /* abandoned */
    scheme->interrupted = true;
    scheme->wait_epochs =
        (int64_t)(FIRST_WAIT_S * pow(2.0, scheme->tries) * 1e9 / (double)fw->period_ns);
}

/* Wait for an epoch; whether both axes stand and the scheme is to be resumed. */
bool scheme_wait(struct firmware *fw)
{
    struct scheme *scheme = &fw->scheme;
    bool is_ready = true;
    for (int k = 0; k < AXES; k++)
        is_ready = is_ready && fw->axis[k].state == STANDS && fw->axis[k].silent_epochs == 0 &&
                   scheme->command[k] == HOLD;
    if (scheme->wait_epochs > 0) {
        scheme->wait_epochs--;
        is_ready = false;
    }
    if (!scheme->homing && scheme->epochs < position_epochs(fw))
        scheme->epochs++;
    return is_ready;
}

void scheme_resume(struct firmware *fw)
{
    struct scheme *scheme = &fw->scheme;
    scheme->running = true;
    scheme->interrupted = false;
    scheme->tries++;
    if (scheme->homing)
        scheme->epochs = 0;
    scheme->turn_begun = scheme->epochs;
    for (int axis = 0; axis < AXES; axis++) {
        scheme->start_deg[axis] = unwrapped(fw->axis[axis].angle_deg, scheme->target_deg[axis]);
        scheme->command[axis] = POSITION;
    }
}

/* Where an axis is expected: ramp up, turn at the full rate, ramp down. */
static double expected_deg(const struct firmware *fw, int axis)
{
    const struct scheme *scheme = &fw->scheme;
    double start = scheme->start_deg[axis], target = scheme->target_deg[axis];
    double turn = fabs(target - start), a = fw->setup.axis_acceleration_dps2;
    double rate = fmin(fw->setup.turn_rate_dps, sqrt(turn * a)), ramp, total, t, done;
    if (rate == 0.0)
        return target;
    ramp = rate / a;
    total = turn / rate + ramp;
    t = seconds_of(fw, scheme->epochs - scheme->turn_begun) - 0.5 * fw->setup.axis_rise_s;
    if (t <= 0.0)
        return start;
    if (t >= total)
        return target;
    if (t > total - ramp)
        done = turn - 0.5 * a * (total - t) * (total - t);
    else if (t > ramp)
        done = rate * (t - 0.5 * ramp);
    else
        done = 0.5 * a * t * t;
    return start + copysign(done, target - start);
}

/* Whether an axis does not follow: too far off, at fault, or silent for too long. */
bool scheme_watch(struct firmware *fw)
{
    double silence = rint(fw->setup.axis_silence_s * (double)fw->setup.rate_hz);
    bool is_found = false;
    for (int k = 0; k < AXES; k++) {
        const struct axis *axis = &fw->axis[k];
        double expected = expected_deg(fw, k);
        double lag = unwrapped(axis->angle_deg, expected) - expected;
        if ((double)axis->silent_epochs > silence || axis->state == AXIS_FAULT ||
            fabs(lag) > fw->setup.follow_tolerance_deg) {
            is_found = true;
            fw->scheme.not_following[k] = true;
        }
    }
    return is_found;
}
