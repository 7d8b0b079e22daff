/* The routine `calibration`: the bias of every sensor from a record at standstill. */
#include <math.h>
#include <string.h>

#include "uds.h"

/* Mean and variance of the increments of one kind of sensor. */
struct record {
    double first[SENSORS], count[SENSORS], sum[SENSORS], square[SENSORS];
};

static struct record records[2];
static int64_t epochs, wanted;
static bool stores, is_stored;
static struct write_job *job;

static bool is_at_rest(const struct rrins_firmware_ram *ram)
{
    for (int axis = 0; axis < 2; axis++) {
        int64_t state = ram->assembly.axis_state[axis];
        double rate_dps = ram->assembly.encoder_rate_dps[axis];
        if ((state != AXIS_HOLDING && state != AXIS_OFF) || rate_dps < 0.0 || rate_dps > 0.0)
            return false;
    }
    return true;
}

bool calibration_may_start(const struct computer *computer)
{
    return computer->ram->modes.mode == RRINS_MODE_STANDBY && is_at_rest(computer->ram);
}

void calibration_start(struct server *server, const uint8_t *arguments)
{
    (void)server;
    memset(records, 0, sizeof records);
    stores = arguments[AT_CALIBRATION_STORE] != 0;
    is_stored = false;
    job = NULL;
    epochs = 0;
    wanted = (int64_t)nearbyint((double)number_at(arguments + AT_CALIBRATION_DURATION_S, 2) * 1e9 /
                                PERIOD_NS);
}

void calibration_forget(struct server *server)
{
    (void)server;
    job = NULL;
}

/* Add an epoch's increments of the valid sensors. */
static void add(struct record *record, const double *increments, int64_t valid)
{
    for (int s = 0; s < SENSORS; s++) {
        double difference;
        if ((valid >> s & 1) == 0)
            continue;
        if (!(record->count[s] > 0.0))
            record->first[s] = increments[s];
        difference = increments[s] - record->first[s]; /* small: nothing is lost in squaring */
        record->count[s] += 1.0;
        record->sum[s] += difference;
        record->square[s] += difference * difference;
    }
}

static bool is_whole(const struct record *record, int64_t count)
{
    for (int64_t s = 0; s < count; s++)
        if (record->count[s] < (1.0 - MISSING_SHARE) * (double)epochs)
            return false;
    return true;
}

static double mean(const struct record *record, int s)
{
    return record->first[s] + record->sum[s] / fmax(1.0, record->count[s]);
}

static double sigma(const struct record *record, int s)
{
    double count = fmax(2.0, record->count[s]);
    double variance = (record->square[s] - record->sum[s] * record->sum[s] / count) / (count - 1.0);
    return sqrt(fmax(0.0, variance) / count);
}

/* The bias of a sensor in the unit of its kind: what is left of the Earth's rate, or of gravity. */
static double bias(const struct computer *computer, int kind, int s)
{
    const struct rrins_firmware_ram *ram = computer->ram;
    const struct rrins_firmware_fusion *fusion = kind == 0 ? &ram->gyros : &ram->accelerometers;
    const double seconds = PERIOD_NS * 1e-9, latitude = ram->parameters.latitude;
    const double rate_n[3] = {0.0, EARTH_RATE * cos(latitude), EARTH_RATE * sin(latitude)};
    const double force_n[3] = {0.0, 0.0, computer->gravity};
    const double *vector_n = kind == 0 ? rate_n : force_n;
    double along = 0.0;
    for (int i = 0; i < 3; i++) {
        double component = 0.0;
        for (int n = 0; n < 3; n++) {
            double C_n_s = 0.0;
            for (int b = 0; b < 3; b++)
                C_n_s += ram->parameters.C_b_n[n][b] * ram->C_s_b[b][i];
            component += C_n_s * vector_n[n];
        }
        along += fusion->H[s][i] * component;
    }
    /* The measurements are already compensated: the rest adds to the bias in effect. */
    return (mean(&records[kind], s) - along * seconds + fusion->bias_increment[s]) /
           (seconds * (kind == 0 ? DPH : UG));
}

/* Start storing the biases; false if one is beyond its limits. */
static bool keep(struct computer *computer)
{
    static struct stored changes;
    static const size_t first[] = {P_GYRO_CALIBRATION, P_ACCELEROMETER_CALIBRATION};
    static const int counts[] = {GYROS, ACCELEROMETERS};
    memset(&changes, 0, sizeof changes);
    for (int kind = 0; kind < 2; kind++)
        for (int s = 0; s < counts[kind]; s++) {
            size_t parameter = first[kind] + (size_t)s;
            struct out found = {.size = 0};
            put_f64(&found, bias(computer, kind, s));
            store_record(&changes, parameter, value_with(&computer->memory.stored, parameter));
            memcpy(changes.records[parameter], found.at, found.size);
            if (!may_be_written(&parameters[parameter].identifier->layout,
                                changes.records[parameter]))
                return false;
        }
    job = parameters_change(&computer->memory, &changes);
    return true;
}

static enum routine_state finish(struct computer *computer)
{
    if (!is_whole(&records[0], GYROS) || !is_whole(&records[1], ACCELEROMETERS))
        return FAILED;
    if (!stores)
        return FINISHED;
    return keep(computer) ? RUNNING : FAILED;
}

void calibration_work(struct server *server)
{
    struct computer *computer = &server->computer;
    struct programme *programme = &server->programmes[ROUTINE_CALIBRATION];
    double increments[2][SENSORS];
    if (job != NULL) {
        if (!write_job_is_done(job))
            return;
        is_stored = parameters_finish(&computer->memory, job);
        programme->state = is_stored ? FINISHED : FAILED;
        job = NULL;
        return;
    }
    if (!calibration_may_start(computer)) {
        programme->state = FAILED;
        return;
    }
    memcpy(increments[0], computer->ram->assembly.gyro_dtheta, sizeof increments[0]);
    memcpy(increments[1], computer->ram->assembly.accelerometer_dv, sizeof increments[1]);
    add(&records[0], increments[0], computer->ram->assembly.gyro_valid);
    add(&records[1], increments[1], computer->ram->assembly.accelerometer_valid);
    if (++epochs == wanted)
        programme->state = finish(computer);
}

void put_calibration(const struct server *server, struct out *out)
{
    static const int counts[] = {GYROS, ACCELEROMETERS};
    const double seconds = PERIOD_NS * 1e-9;
    put_number(out, server->programmes[ROUTINE_CALIBRATION].state, 1);
    put_number(out, (uint64_t)epochs, 4);
    for (int kind = 0; kind < 2; kind++)
        for (int s = 0; s < SENSORS; s++)
            put_f32(out, s < counts[kind] ? bias(&server->computer, kind, s) : 0.0);
    for (int kind = 0; kind < 2; kind++)
        for (int s = 0; s < SENSORS; s++)
            put_f32(out, s < counts[kind]
                             ? sigma(&records[kind], s) / (seconds * (kind == 0 ? DPH : UG))
                             : 0.0);
    put_number(out, is_stored, 1);
}
