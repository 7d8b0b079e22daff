/*
 * The routine `table_calibration`: turns the table through a scheme and records sums of a second.
 * The sums and the watch of the axes are those of the firmware, compiled.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "uds.h"

enum {
    NUMBERS = HEAD_NUMBERS + SUM_ORIENTATIONS + SUM_TURNS + GYROS + ACCELEROMETERS,
    SECOND_EPOCHS = 1000000000 / PERIOD_NS
};

static struct {
    bool is_homing;
    int end, sensor, moved, count;
    int64_t position, epochs, wanted, left;
    int64_t missing[2][2]; /* kind; bits before, seconds in a row */
    int axes[SCHEME_CAPACITY];
    double turns_deg[SCHEME_CAPACITY], targets_deg[2], stand_s, rate_before_dps;
} table;
static struct rrins_firmware_table_sums sums;
static uint8_t *record;
static size_t record_size, record_room;

size_t table_record(const uint8_t **at)
{
    *at = record;
    return record_size;
}

void table_forget(struct server *server)
{
    (void)server;
    memset(&table, 0, sizeof table);
    table.is_homing = true;
    record_size = 0;
}

static double turn_time_s(const struct rrins_firmware_ram *ram, double turn_deg)
{
    double rate = ram->parameters.turn_rate_dps;
    if (turn_deg < 1e-6)
        return 0.0;
    return turn_deg / rate + (rate / ram->parameters.axis_acceleration_dps2 +
                              ram->parameters.axis_rise_s + SETTLE_S);
}

/* Turn both axes to their targets; know how long that takes. */
static void command(struct computer *computer)
{
    struct rrins_firmware_ram *ram = computer->ram;
    double longest_s = 0.0, stand_s = table.is_homing ? AT_REST_S : table.stand_s;
    for (int axis = 0; axis < 2; axis++) {
        double target_deg = table.targets_deg[axis], span = ram->parameters.angle_span_deg;
        double now_deg = ram->assembly.encoder_angle_deg[axis];
        now_deg += span * nearbyint((target_deg - now_deg) / span);
        ram->sequencer.start_angle_deg[axis] = now_deg;
        turn_axis(computer, axis, target_deg);
        longest_s = fmax(longest_s, turn_time_s(ram, fabs(target_deg - now_deg)));
    }
    ram->sequencer.epochs = ram->sequencer.turn_begun = 0;
    table.wanted = (int64_t)nearbyint((longest_s + stand_s) * 1e9 / PERIOD_NS);
    table.wanted = table.wanted > 1 ? table.wanted : 1;
    table.epochs = 0;
}

void table_start(struct server *server, const uint8_t *arguments)
{
    struct rrins_firmware_ram *ram = server->computer.ram;
    const uint8_t *axes = arguments + AT_TABLE_CALIBRATION_AXIS;
    const uint8_t *angles = arguments + AT_TABLE_CALIBRATION_ANGLE_DEG;
    int first = arguments[AT_TABLE_CALIBRATION_FIRST];
    table_forget(server);
    table.count = arguments[AT_TABLE_CALIBRATION_POSITIONS];
    table.stand_s = f64_at(arguments + AT_TABLE_CALIBRATION_STAND_S);
    for (int k = 0; k < table.count; k++) {
        table.axes[k] = axes[k];
        table.turns_deg[k] = f64_at(angles + 8 * k);
    }
    table.rate_before_dps = ram->parameters.turn_rate_dps;
    ram->parameters.turn_rate_dps = f64_at(arguments + AT_TABLE_CALIBRATION_TURN_RATE_DPS);
    table.position = first < table.count ? first : table.count;
    for (int k = 0; k < table.position; k++)
        table.targets_deg[table.axes[k]] += table.turns_deg[k];
    command(&server->computer);
    table.left = 0;
}

/* Let both axes hold, and turn at the former rate from now on. */
static void release(struct computer *computer)
{
    computer->ram->parameters.turn_rate_dps = table.rate_before_dps;
    if (computer->ram->modes.mode == RRINS_MODE_STANDBY) {
        hold_axis(computer, 0);
        hold_axis(computer, 1);
    }
}

void table_stop(struct server *server, bool is_by_session)
{
    table.end = is_by_session ? END_SESSION_ENDED : END_STOPPED;
    release(&server->computer);
}

static void fail(struct server *server, int end, int64_t sensors)
{
    server->programmes[ROUTINE_TABLE_CALIBRATION].state = FAILED;
    table.end = end;
    table.sensor = 0;
    for (int k = SENSORS; k > 0; k--) /* the first of them, from 1 */
        if ((sensors >> (k - 1) & 1) != 0)
            table.sensor = k;
    release(&server->computer);
}

static bool is_running(const struct server *server)
{
    return server->programmes[ROUTINE_TABLE_CALIBRATION].state == RUNNING;
}

static bool is_commanded_otherwise(const struct rrins_firmware_ram *ram)
{
    for (int axis = 0; axis < 2; axis++) {
        double told = ram->sequencer.target_angle_deg[axis];
        if (ram->sequencer.command[axis] != COMMAND_POSITION || told < table.targets_deg[axis] ||
            told > table.targets_deg[axis])
            return true;
    }
    return false;
}

/* End the routine if the mode was left, or an axis does not do what it is told. */
static void watch(struct server *server)
{
    struct rrins_firmware_ram *ram = server->computer.ram;
    ram->sequencer.epochs = table.epochs;
    if (ram->modes.mode != RRINS_MODE_STANDBY)
        fail(server, END_MODE_LEFT, 0);
    else if (is_commanded_otherwise(ram))
        fail(server, END_AXIS_TAKEN, 0);
    else if (rrins_firmware_watch(ram) != 0)
        fail(server, END_AXIS_NOT_FOLLOWING, 0);
}

/* The amount of the velocity of a second, m/s, as if the table had not turned in it. */
static double sensed(void)
{
    double turn = fmax(fmax(fabs(sums.turn[0]), fabs(sums.turn[1])), 1e-9);
    double chord = sin(0.5 * turn) / (0.5 * turn), along, across = 0.0;
    double axis[3] = {0.0, 0.0, 1.0};
    if (fabs(sums.turn[1]) > fabs(sums.turn[0])) {
        axis[0] = sums.turn[2] / sums.turn[1];
        axis[1] = -sums.turn[3] / sums.turn[1];
        axis[2] = 0.0;
    }
    along = axis[0] * sums.velocity_s[0] + axis[1] * sums.velocity_s[1] +
            axis[2] * sums.velocity_s[2];
    for (int k = 0; k < 3; k++) {
        double rest = sums.velocity_s[k] - along * axis[k];
        across += rest * rest;
    }
    return hypot(along, sqrt(across) / chord);
}

/* Whether the base seems to move in a second. */
static bool moves(const struct computer *computer, double seconds)
{
    double x = sums.rotation_s[0] - sums.turn[2], y = sums.rotation_s[1] + sums.turn[3];
    double z = sums.rotation_s[2] - sums.turn[0];
    double off = sensed() - computer->gravity * seconds;
    return sqrt(x * x + y * y + z * z) > TURN_LIMIT * seconds ||
           fabs(off) > FORCE_LIMIT * seconds;
}

/* End the routine if a sensor has failed, or the base moves. */
static void guard(struct server *server, double seconds)
{
    static const int ends[] = {END_GYRO_FAILED, END_ACCELEROMETER_FAILED};
    const struct rrins_firmware_ram *ram = server->computer.ram;
    const int64_t bits[] = {sums.gyro_missing, sums.accelerometer_missing};
    const int64_t stuck[] = {ram->diagnostics.gyro_repetition.stuck,
                             ram->diagnostics.accelerometer_repetition.stuck};
    for (int kind = 0; kind < 2; kind++) {
        int64_t both = table.missing[kind][1] != 0 ? bits[kind] & table.missing[kind][0]
                                                   : bits[kind];
        table.missing[kind][0] = both;
        table.missing[kind][1] = both != 0 ? table.missing[kind][1] + 1 : 0;
        if (table.missing[kind][1] >= MISSING_S) {
            fail(server, ends[kind], both);
            return;
        }
    }
    for (int kind = 0; kind < 2; kind++)
        if (stuck[kind] != 0) {
            fail(server, ends[kind], stuck[kind]);
            return;
        }
    if (bits[0] != 0 || bits[1] != 0 || sums.axis_missing)
        return;
    table.moved = moves(&server->computer, seconds) ? table.moved + 1 : 0;
    if (table.moved >= MOVED_S)
        fail(server, END_BASE_MOVED, 0);
}

/* Add a row to the record; false if there is no room for it. */
static bool add_row(const struct rrins_firmware_ram *ram)
{
    const double head[HEAD_NUMBERS] = {
        (double)ram->epoch, (double)sums.epochs, (double)table.position, (double)sums.gyro_missing,
        (double)sums.accelerometer_missing, (double)sums.axis_missing,
        ram->assembly.encoder_angle_deg[0], ram->assembly.encoder_angle_deg[1]};
    double row[NUMBERS];
    memcpy(row, head, sizeof head);
    memcpy(row + HEAD_NUMBERS, sums.orientation, sizeof sums.orientation);
    memcpy(row + HEAD_NUMBERS + SUM_ORIENTATIONS, sums.turn, sizeof sums.turn);
    memcpy(row + NUMBERS - GYROS - ACCELEROMETERS, sums.gyro, GYROS * sizeof *row);
    memcpy(row + NUMBERS - ACCELEROMETERS, sums.accelerometer, ACCELEROMETERS * sizeof *row);
    if (record_size + sizeof row > record_room) {
        size_t room = record_room == 0 ? 1024 * sizeof row : 2 * record_room;
        uint8_t *larger = realloc(record, room);
        if (larger == NULL)
            return false;
        record = larger;
        record_room = room;
    }
    memcpy(record + record_size, row, sizeof row);
    record_size += sizeof row;
    return true;
}

/* Keep the second in the record, if nothing is wrong with it. */
static void close_second(struct server *server)
{
    double seconds = (double)(sums.epochs * PERIOD_NS) * 1e-9;
    if (seconds > 0.0) {
        guard(server, seconds);
        if (!add_row(server->computer.ram))
            fail(server, END_STOPPED, 0);
    }
    rrins_firmware_begin_sums(&sums);
    table.left = SECOND_EPOCHS;
}

/* Go on to the next position, or end. */
static void advance(struct server *server)
{
    struct computer *computer = &server->computer;
    if (!table.is_homing) {
        table.position++;
    } else {
        table.is_homing = false;
        memset(&sums, 0, sizeof sums);
        rrins_firmware_add_sums(computer->ram, &sums);
    }
    if (table.position >= table.count) {
        server->programmes[ROUTINE_TABLE_CALIBRATION].state = FINISHED;
        table.end = END_DONE;
        release(computer);
        return;
    }
    table.targets_deg[table.axes[table.position]] += table.turns_deg[table.position];
    command(computer);
    table.left = SECOND_EPOCHS;
}

void table_work(struct server *server)
{
    bool is_over = ++table.epochs >= table.wanted;
    if (is_over || table.epochs % WATCH_EPOCHS == 0)
        watch(server);
    if (is_running(server) && !table.is_homing) {
        rrins_firmware_add_sums(server->computer.ram, &sums);
        if (--table.left == 0 || is_over)
            close_second(server);
    }
    if (is_over && is_running(server))
        advance(server);
}

void put_table(const struct server *server, struct out *out)
{
    const size_t size = NUMBERS * sizeof(double);
    put_number(out, server->programmes[ROUTINE_TABLE_CALIBRATION].state, 1);
    put_number(out, (uint64_t)table.end, 1);
    put_number(out, (uint64_t)table.sensor, 1);
    put_number(out, (uint64_t)table.position, 1);
    put_number(out, record_size / size, 4);
    put_number(out, size, 2);
    put_number(out, PERIOD_NS, 4);
}
