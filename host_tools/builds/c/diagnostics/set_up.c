/* The memory at power-on with the parameters that are stored. */
#include <math.h>
#include <string.h>

#include "uds.h"

/* The method of alignment and the treatment of the height that parameters ask for, or NULL if the
 * program has no room for that. */
static const struct choice *choice_of(const struct stored *stored)
{
    int method = value_with(stored, P_ALIGNMENT)[AT_ALIGNMENT_METHOD];
    int channel = value_with(stored, P_HEIGHT_CHANNEL)[0];
    for (size_t k = 0; k < CHOICES; k++)
        if (choices[k].method == method && choices[k].height_channel == channel)
            return &choices[k];
    return NULL;
}

bool is_built(const struct stored *stored)
{
    return choice_of(stored) != NULL;
}

static int count_of(int kind)
{
    return kind == 0 ? GYROS : ACCELEROMETERS;
}

/* Invert a symmetric matrix; false if it is singular. */
static bool invert(double A[3][3], double inverse[3][3])
{
    double determinant;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            int a = (i + 1) % 3, b = (i + 2) % 3, c = (k + 1) % 3, d = (k + 2) % 3;
            inverse[k][i] = A[a][c] * A[b][d] - A[a][d] * A[b][c];
        }
    determinant = A[0][0] * inverse[0][0] + A[0][1] * inverse[1][0] + A[0][2] * inverse[2][0];
    if (!(fabs(determinant) > 0.0))
        return false;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            inverse[i][k] /= determinant;
    return true;
}

/* The matrix (H' W H)^-1 of weighted axes; false if they do not span space. */
static bool covariance(const double (*H)[3], const double *weights, int count, double P[3][3])
{
    double A[3][3] = {{0.0}};
    for (int s = 0; s < count; s++)
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                A[i][k] += weights[s] * H[s][i] * H[s][k];
    return invert(A, P);
}

/*
 * The largest element of (H' W H)^-1 H' W. By Cauchy and Binet it is of sums over three sensors
 * each, in which nothing cancels, however far apart the weights are.
 */
static double largest_gain(const double (*H)[3], const double *weights, int count)
{
    double sums[SENSORS][3] = {{0.0}}, determinant = 0.0, largest = 0.0;
    for (int a = 0; a < count; a++)
        for (int b = 0; b < a; b++) {
            double normal[3];
            for (int i = 0; i < 3; i++)
                normal[i] = H[a][(i + 1) % 3] * H[b][(i + 2) % 3] -
                            H[a][(i + 2) % 3] * H[b][(i + 1) % 3];
            for (int s = 0; s < count; s++) {
                double volume = H[s][0] * normal[0] + H[s][1] * normal[1] + H[s][2] * normal[2];
                double part = weights[a] * weights[b] * weights[s] * volume;
                if (s == a || s == b)
                    continue;
                determinant += part * volume / 3.0; /* each three sensors come thrice */
                for (int i = 0; i < 3; i++)
                    sums[s][i] += part * normal[i];
            }
        }
    for (int s = 0; s < count; s++)
        for (int i = 0; i < 3; i++)
            largest = fmax(largest, fabs(sums[s][i]));
    return determinant > 0.0 ? largest / determinant : HUGE_VAL;
}

/* The limits of `rrins.firmware_py.core.settings.check_weights`. */
bool weights_are_usable(const struct stored *stored, int kind)
{
    size_t parameter = kind == 0 ? P_GYRO_WEIGHTS : P_ACCELEROMETER_WEIGHTS;
    int count = count_of(kind);
    double weights[SENSORS], least = HUGE_VAL, most = 0.0;
    if (!stored->is_there[parameter])
        return true;
    for (int s = 0; s < count; s++) {
        weights[s] = f64_at(stored->records[parameter] + 8 * s);
        least = fmin(least, weights[s]);
        most = fmax(most, weights[s]);
    }
    if (least <= 0.0 || most > WEIGHT_RATIO_LIMIT * least)
        return false;
    for (int s = 0; s < count; s++)
        weights[s] /= most;
    return largest_gain(input_axes[kind], weights, count) <= GAIN_LIMIT;
}

bool can_be_set_up(const struct stored *stored)
{
    return is_built(stored) && weights_are_usable(stored, 0) && weights_are_usable(stored, 1);
}

static int64_t epochs_of(double seconds)
{
    return (int64_t)nearbyint(seconds * RATE_HZ);
}

/* One stored value of eight bytes. */
static double number(const struct stored *stored, size_t parameter, size_t at)
{
    return f64_at(stored->records[parameter] + at);
}

/* One of a setting's, and of a sensor's calibration. */
#define SETTING(parameter, name) number(stored, P_##parameter, AT_##parameter##_##name)
#define CONSTANT(record, name) f64_at((record) + AT_CALIBRATION_##name)

static void set_settings(struct rrins_firmware_ram *ram, const struct stored *stored)
{
    const double dt = 1.0 / RATE_HZ;
    if (stored->is_there[P_START_POSITION]) {
        ram->parameters.latitude = SETTING(START_POSITION, LATITUDE_DEG) * DEGREE;
        ram->parameters.longitude = SETTING(START_POSITION, LONGITUDE_DEG) * DEGREE;
        ram->parameters.height = SETTING(START_POSITION, HEIGHT_M);
    }
    if (stored->is_there[P_INITIAL_ATTITUDE]) {
        const double angles[3] = {SETTING(INITIAL_ATTITUDE, ROLL_DEG) * DEGREE,
                                  SETTING(INITIAL_ATTITUDE, PITCH_DEG) * DEGREE,
                                  SETTING(INITIAL_ATTITUDE, HEADING_DEG) * DEGREE};
        rrins_firmware_set_attitude(ram, angles);
    }
    if (stored->is_there[P_ALIGNMENT]) {
        int64_t epochs = epochs_of(SETTING(ALIGNMENT, ALIGNMENT_S));
        ram->parameters.alignment_epochs = epochs > 1 ? epochs : 1;
    }
    if (stored->is_there[P_BRIDGE])
        ram->parameters.bridge_epochs = epochs_of(SETTING(BRIDGE, BRIDGE_S));
    if (stored->is_there[P_AXIS_WATCH]) {
        ram->parameters.follow_tolerance_deg = SETTING(AXIS_WATCH, FOLLOW_TOLERANCE_DEG);
        ram->parameters.axis_silence_epochs = epochs_of(SETTING(AXIS_WATCH, AXIS_SILENCE_S));
    }
    if (stored->is_there[P_CONSISTENCY]) {
        ram->parameters.gyro_consistency = SETTING(CONSISTENCY, GYRO_CONSISTENCY_DPH) * DPH * dt;
        ram->parameters.accelerometer_consistency =
            SETTING(CONSISTENCY, ACCELEROMETER_CONSISTENCY_UG) * UG * dt;
    }
    if (stored->is_there[P_CALIBRATED]) {
        bool is_known = stored->records[P_CALIBRATED][AT_CALIBRATED_TEMPERATURE_KNOWN] != 0;
        ram->calibration.date_utc_s = (int64_t)number_at(stored->records[P_CALIBRATED], 4);
        ram->calibration.temperature_known = is_known;
        ram->calibration.temperature_c = is_known ? SETTING(CALIBRATED, TEMPERATURE_C) : 0.0;
    }
}

/* The sensors of a kind: weights, and h' = h - du v - dv u, paper (13). */
static void set_sensors(struct rrins_firmware_fusion *fusion, const struct stored *stored,
                        int kind)
{
    const double dt = 1.0 / RATE_HZ, unit = kind == 0 ? DPH : UG;
    const size_t weights = kind == 0 ? P_GYRO_WEIGHTS : P_ACCELEROMETER_WEIGHTS;
    const size_t first = kind == 0 ? P_GYRO_CALIBRATION : P_ACCELEROMETER_CALIBRATION;
    bool is_calibrated = false;
    for (size_t s = 0; s < (size_t)count_of(kind); s++) {
        if (stored->is_there[weights])
            fusion->weight[s] = number(stored, weights, 8 * s);
        if (stored->is_there[first + s]) {
            double du = CONSTANT(stored->records[first + s], INSTALLATION_U_ARCSEC) * ARCSEC;
            double dv = CONSTANT(stored->records[first + s], INSTALLATION_V_ARCSEC) * ARCSEC;
            for (int k = 0; k < 3; k++)
                fusion->H[s][k] = input_axes[kind][s][k] - du * transverse_v[kind][s][k] -
                                  dv * transverse_u[kind][s][k];
            fusion->bias_increment[s] = number(stored, first + s, 0) * unit * dt;
            fusion->scale_error[s] = CONSTANT(stored->records[first + s], SCALE_ERROR_PPM) * PPM;
            fusion->asymmetric_scale_error[s] =
                CONSTANT(stored->records[first + s], ASYMMETRIC_SCALE_ERROR_PPM) * PPM;
        }
        is_calibrated |= fabs(fusion->bias_increment[s]) > 0.0 ||
                         fabs(fusion->scale_error[s]) > 0.0 ||
                         fabs(fusion->asymmetric_scale_error[s]) > 0.0;
    }
    fusion->calibrated = is_calibrated;
}

static void set_positions(struct rrins_firmware_size_effect *effect, const struct stored *stored)
{
    bool is_present = false;
    for (size_t s = 0; s < ACCELEROMETERS; s++)
        for (size_t k = 0; k < 3; k++) {
            if (stored->is_there[P_ACCELEROMETER_CALIBRATION + s])
                effect->position_s[s][k] =
                    CONSTANT(stored->records[P_ACCELEROMETER_CALIBRATION + s] + 8 * k,
                             POSITION_X_MM) * 1e-3;
            is_present |= fabs(effect->position_s[s][k]) > 0.0;
        }
    effect->present = is_present;
}

/* What the parity compares with: the covariance of each sensor's h (1 + scale error). */
static void set_drift(struct rrins_firmware_drift *drift, const struct stored *stored, int kind)
{
    static const double stability[] = SCALE_STABILITY, limits[] = DRIFT_LIMIT;
    const size_t first = kind == 0 ? P_GYRO_SIGMA : P_ACCELEROMETER_SIGMA;
    bool is_known = true;
    for (size_t s = 0; s < (size_t)count_of(kind); s++) {
        const uint8_t *sigma = value_with(stored, first + s);
        const double scale = CONSTANT(sigma, SCALE_ERROR_PPM) * PPM;
        const double du = CONSTANT(sigma, INSTALLATION_U_ARCSEC) * ARCSEC;
        const double dv = CONSTANT(sigma, INSTALLATION_V_ARCSEC) * ARCSEC;
        const double along = hypot(scale, stability[kind]);
        const double *h = input_axes[kind][s], *u = transverse_u[kind][s],
                     *v = transverse_v[kind][s];
        is_known = is_known && scale > 0.0 && du > 0.0 && dv > 0.0;
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                drift->axis_variance[s][i][k] = along * along * h[i] * h[k] +
                                                du * du * v[i] * v[k] + dv * dv * u[i] * u[k];
    }
    drift->known = is_known;
    drift->limit = is_known ? limits[kind] : 0.0;
    if (!is_known)
        memset(drift->axis_variance, 0, sizeof drift->axis_variance);
}

/* How much of one sensor's error a component of the fused vector has, at most. */
static double fused(const struct rrins_firmware_fusion *fusion)
{
    double P[3][3], H[SENSORS][3], weights[SENSORS];
    memcpy(H, fusion->H, sizeof H);
    for (int s = 0; s < SENSORS; s++)
        weights[s] = 1.0;
    if (!covariance((const double (*)[3])H, weights, (int)fusion->count, P))
        return 0.0;
    return sqrt(fmax(P[0][0], fmax(P[1][1], P[2][2])));
}

static double noise(const struct rrins_firmware_ram *ram, int kind, double seconds)
{
    double most = 0.0;
    for (int s = 0; s < count_of(kind); s++)
        most = fmax(most, ram->estimator.white_variance[kind][s]);
    return sqrt(most) / sqrt(seconds);
}

/* The attitude's standard deviations after a self-alignment, which position, duration and
 * calibration change: `rrins.firmware_py.core.estimator.settings._attitude_sigma`. */
static void set_attitude_sigma(struct rrins_firmware_ram *ram, double gravity)
{
    enum { SCALE, INSTALLATION = 2, CONSTANTS = 4 };
    double seconds = (double)(ram->parameters.alignment_epochs * PERIOD_NS) * 1e-9;
    double askew = 0.0, turned = 0.0, force, rate, level, heading = LEAST_HEADING;
    if (!ram->estimator.enabled || ram->parameters.initial_attitude == METHOD_GIVEN ||
        ram->parameters.initial_attitude == METHOD_TRANSFERRED)
        return;
    if (ram->estimator.constants) {
        askew = gravity * ram->estimator.constant_sigma[CONSTANTS + INSTALLATION];
        turned = EARTH_RATE * hypot(ram->estimator.constant_sigma[INSTALLATION],
                                    ram->estimator.constant_sigma[SCALE]);
    }
    force = hypot(ram->estimator.bias_sigma[1], askew) * fused(&ram->accelerometers);
    level = fmax(hypot(force, noise(ram, 1, seconds)) / gravity, LEAST_LEVEL);
    if (ram->parameters.initial_attitude == METHOD_SELF_ALIGNED) {
        rate = hypot(ram->estimator.bias_sigma[0], turned) * fused(&ram->gyros);
        heading = fmax(hypot(rate, noise(ram, 0, seconds)) /
                           (EARTH_RATE * cos(ram->parameters.latitude)), LEAST_HEADING);
    }
    ram->estimator.attitude_sigma[0] = ram->estimator.attitude_sigma[1] = level;
    ram->estimator.attitude_sigma[2] = heading;
}

static bool is_empty(const struct stored *stored)
{
    static const bool none[PARAMETERS];
    return memcmp(stored->is_there, none, sizeof none) == 0;
}

void computer_power_on(struct computer *computer)
{
    struct rrins_firmware_ram *ram = computer->ram;
    const struct stored *stored = &computer->memory.stored;
    const struct choice *choice = choice_of(stored);
    double found[DERIVED];
    rrins_firmware_power_on(ram);
    for (size_t k = 0; k < choice->count; k++)
        memcpy((uint8_t *)ram + choice->patches[k].offset, choice->patches[k].bytes,
               choice->patches[k].size);
    set_settings(ram, stored);
    set_sensors(&ram->gyros, stored, 0);
    set_sensors(&ram->accelerometers, stored, 1);
    set_positions(&ram->size_effect, stored);
    rrins_firmware_derive(ram, found);
    computer->gravity = found[DERIVED_GRAVITY];
    if (!is_empty(stored)) {
        if (IS_REDUNDANT) {
            set_drift(&ram->calibration.gyros, stored, 0);
            set_drift(&ram->calibration.accelerometers, stored, 1);
        }
        set_attitude_sigma(ram, computer->gravity);
    }
    ram->diagnostics.memory_faults = computer->memory.faults;
}
