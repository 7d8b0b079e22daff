/* Routine control, 0x31, and the routines at work; the two calibrations have files of their own. */
#include <math.h>
#include <string.h>

#include "uds.h"

enum { START = 1, STOP = 2 };

static int axis;
static double target_deg;
static int64_t epochs_left;
static struct write_job *restoring;

static int64_t mode_of(const struct server *server)
{
    return server->computer.ram->modes.mode;
}

static void ask(struct server *server, int64_t request)
{
    server->computer.ram->diagnostics.routine_request = request;
}

bool routines_are_busy(const struct server *server)
{
    for (size_t k = 0; k < ROUTINES; k++)
        if (server->programmes[k].state == RUNNING)
            return true;
    return false;
}

static bool may_start(const struct server *server, int routine)
{
    const struct rrins_firmware_ram *ram = server->computer.ram;
    int64_t mode = mode_of(server);
    switch ((enum routine_index)routine) {
    case ROUTINE_SELF_TEST:
        return mode == RRINS_MODE_STANDBY || mode == RRINS_MODE_FAULT;
    case ROUTINE_ALIGNMENT:
    case ROUTINE_TABLE_CALIBRATION:
        return mode == RRINS_MODE_STANDBY;
    case ROUTINE_GO_TO_AXIS_ANGLE:
        return axes_may_turn(&server->computer);
    case ROUTINE_ROTATION:
        return mode == RRINS_MODE_NAVIGATION_STRAPDOWN;
    case ROUTINE_CALIBRATION:
        return calibration_may_start(&server->computer);
    case ROUTINE_STANDBY:
        return mode == RRINS_MODE_ALIGNMENT || mode == RRINS_MODE_NAVIGATION_STRAPDOWN ||
               mode == RRINS_MODE_NAVIGATION_ROTATING;
    case ROUTINE_READMIT_SENSOR:
        return ram->redundancy.enabled &&
               ram->redundancy.readmission.state != READMISSION_TESTING;
    case ROUTINE_RESTORE_SET_UP:
        return true;
    }
    return false;
}

static void start_turn(struct server *server, const uint8_t *arguments)
{
    struct rrins_firmware_ram *ram = server->computer.ram;
    double turn_deg, seconds;
    axis = arguments[AT_GO_TO_AXIS_ANGLE_AXIS];
    target_deg = f64_at(arguments + AT_GO_TO_AXIS_ANGLE_ANGLE_DEG);
    turn_deg = fabs(target_deg - ram->assembly.encoder_angle_deg[axis]);
    seconds = 2.0 * turn_deg / ram->parameters.turn_rate_dps + GRACE_S;
    epochs_left = (int64_t)nearbyint(seconds * 1e9 / PERIOD_NS);
    turn_axis(&server->computer, axis, target_deg);
}

static void start(struct server *server, int routine, const uint8_t *arguments)
{
    static const struct stored nothing;
    struct rrins_firmware_ram *ram = server->computer.ram;
    struct programme *programme = &server->programmes[routine];
    programme->state = RUNNING;
    switch ((enum routine_index)routine) {
    case ROUTINE_SELF_TEST:
        ask(server, REQUEST_SELF_TEST);
        break;
    case ROUTINE_ALIGNMENT:
        ask(server, REQUEST_ALIGN);
        break;
    case ROUTINE_ROTATION:
        ask(server, REQUEST_START_ROTATION);
        break;
    case ROUTINE_STANDBY:
        ask(server, REQUEST_STANDBY);
        break;
    case ROUTINE_GO_TO_AXIS_ANGLE:
        start_turn(server, arguments);
        return;
    case ROUTINE_CALIBRATION:
        calibration_start(server, arguments);
        return;
    case ROUTINE_TABLE_CALIBRATION:
        table_start(server, arguments);
        return;
    case ROUTINE_READMIT_SENSOR:
        ram->redundancy.readmission.order_kind = arguments[AT_READMIT_SENSOR_KIND];
        ram->redundancy.readmission.order_sensor = arguments[AT_READMIT_SENSOR_SENSOR];
        ram->redundancy.readmission.order_s =
            (int64_t)number_at(arguments + AT_READMIT_SENSOR_TEST_S, 2);
        ram->redundancy.readmission.order_anew = arguments[AT_READMIT_SENSOR_ANEW];
        ram->redundancy.readmission.order = ORDER_TEST;
        break;
    case ROUTINE_RESTORE_SET_UP:
        restoring = parameters_replace(&server->computer.memory, &nothing);
        return;
    }
    programme->waits = true;
}

static bool can_be_stopped(const struct server *server, int routine)
{
    if (routine == ROUTINE_ROTATION)
        return mode_of(server) == RRINS_MODE_NAVIGATION_ROTATING;
    if (routine == ROUTINE_READMIT_SENSOR)
        return server->computer.ram->redundancy.readmission.state == READMISSION_TESTING;
    return server->programmes[routine].state == RUNNING;
}

static void stop(struct server *server, int routine, bool is_by_session)
{
    server->programmes[routine].state = STOPPED;
    if (routine == ROUTINE_ALIGNMENT)
        ask(server, REQUEST_STANDBY);
    else if (routine == ROUTINE_ROTATION)
        ask(server, REQUEST_STOP_ROTATION);
    else if (routine == ROUTINE_READMIT_SENSOR)
        server->computer.ram->redundancy.readmission.order = ORDER_STOP;
    else if (routine == ROUTINE_TABLE_CALIBRATION)
        table_stop(server, is_by_session);
    else if (routine == ROUTINE_GO_TO_AXIS_ANGLE && is_told(&server->computer, axis, target_deg))
        hold_axis(&server->computer, axis);
}

void routines_leave_session(struct server *server)
{
    static const int ended[] = {ROUTINE_GO_TO_AXIS_ANGLE, ROUTINE_CALIBRATION,
                                ROUTINE_TABLE_CALIBRATION};
    for (size_t k = 0; k < sizeof ended / sizeof *ended; k++)
        if (server->programmes[ended[k]].state == RUNNING)
            stop(server, ended[k], true);
}

void routines_forget(struct server *server)
{
    for (size_t k = 0; k < ROUTINES; k++)
        server->programmes[k].state = NEVER_STARTED;
    calibration_forget(server);
    table_forget(server);
}

/* The outcome of a routine whose mode is over. */
static enum routine_state ended(const struct server *server, int routine)
{
    const struct rrins_firmware_ram *ram = server->computer.ram;
    if (routine == ROUTINE_SELF_TEST)
        return ram->modes.fault == FAULT_SELF_TEST_FAILED ? FAILED : FINISHED;
    if (routine == ROUTINE_ROTATION)
        return ram->sequencer.not_following[0] || ram->sequencer.not_following[1] ? FAILED
                                                                                   : STOPPED;
    if (ram->alignment.done)
        return FINISHED;
    return ram->modes.mode == RRINS_MODE_FAULT ? FAILED : STOPPED;
}

static void work_in_mode(struct server *server, int routine, int64_t running)
{
    struct programme *programme = &server->programmes[routine];
    programme->waits = false; /* the step has handled the request by now */
    if (mode_of(server) != running)
        programme->state = ended(server, routine);
    if (routine == ROUTINE_ALIGNMENT && programme->state == RUNNING &&
        server->computer.ram->alignment.done)
        programme->state = FINISHED;
}

static void work_turn(struct server *server)
{
    struct programme *programme = &server->programmes[ROUTINE_GO_TO_AXIS_ANGLE];
    const struct rrins_firmware_ram *ram = server->computer.ram;
    double off_deg = fabs(ram->assembly.encoder_angle_deg[axis] - target_deg);
    epochs_left--;
    if (!is_told(&server->computer, axis, target_deg)) {
        programme->state = STOPPED; /* another command replaced this one */
    } else if (ram->assembly.axis_state[axis] == AXIS_HOLDING && off_deg <= ARRIVED_DEG) {
        programme->state = FINISHED;
    } else if (epochs_left <= 0) {
        programme->state = FAILED;
        hold_axis(&server->computer, axis);
    }
}

static void work_readmission(struct server *server)
{
    static const enum routine_state outcomes[] = READMISSION_OUTCOMES;
    struct programme *programme = &server->programmes[ROUTINE_READMIT_SENSOR];
    programme->waits = false; /* the step has handled the order by now */
    programme->state = outcomes[server->computer.ram->redundancy.readmission.state];
}

static void work(struct server *server, int routine)
{
    struct programme *programme = &server->programmes[routine];
    switch ((enum routine_index)routine) {
    case ROUTINE_SELF_TEST:
        work_in_mode(server, routine, RRINS_MODE_SELF_TEST);
        break;
    case ROUTINE_ALIGNMENT:
        work_in_mode(server, routine, RRINS_MODE_ALIGNMENT);
        break;
    case ROUTINE_ROTATION:
        work_in_mode(server, routine, RRINS_MODE_NAVIGATION_ROTATING);
        break;
    case ROUTINE_STANDBY:
        programme->waits = false;
        programme->state = mode_of(server) == RRINS_MODE_STANDBY ? FINISHED : FAILED;
        break;
    case ROUTINE_GO_TO_AXIS_ANGLE:
        work_turn(server);
        break;
    case ROUTINE_CALIBRATION:
        calibration_work(server);
        break;
    case ROUTINE_TABLE_CALIBRATION:
        table_work(server);
        break;
    case ROUTINE_READMIT_SENSOR:
        work_readmission(server);
        break;
    case ROUTINE_RESTORE_SET_UP:
        break;
    }
}

void routines_work(struct server *server)
{
    for (int k = 0; k < ROUTINES; k++)
        if (server->programmes[k].state == RUNNING)
            work(server, k);
}

/* Whether the response can be given: DONE, LATER, or why it is refused. */
static int settle(struct server *server, int routine)
{
    struct programme *programme = &server->programmes[routine];
    bool went_well;
    if (routine != ROUTINE_RESTORE_SET_UP || restoring == NULL)
        return programme->waits ? LATER : DONE;
    if (!write_job_is_done(restoring))
        return LATER;
    went_well = parameters_finish(&server->computer.memory, restoring);
    restoring = NULL;
    programme->state = went_well ? FINISHED : FAILED;
    return went_well ? DONE : GENERAL_PROGRAMMING_FAILURE;
}

static void put_results(struct server *server, int routine, struct out *out)
{
    const struct rrins_firmware_ram *ram = server->computer.ram;
    const struct layout *results = &routines[routine].results;
    if (routine == ROUTINE_CALIBRATION) {
        put_calibration(server, out);
        return;
    }
    if (routine == ROUTINE_TABLE_CALIBRATION) {
        put_table(server, out);
        return;
    }
    put_number(out, server->programmes[routine].state, 1);
    if (routine == ROUTINE_GO_TO_AXIS_ANGLE) {
        put_number(out, (uint64_t)axis, 1);
        put_f64(out, ram->assembly.encoder_angle_deg[axis]);
        put_number(out, (uint64_t)ram->assembly.axis_state[axis], 1);
        return;
    }
    for (size_t k = 1; k < results->count; k++)
        put_field(out, &results->fields[k], ram, server);
}

static int routine_of(const uint8_t *at)
{
    for (int k = 0; k < ROUTINES; k++)
        if (routines[k].number == number_at(at, 2))
            return k;
    return -1;
}

static int poll_routine(struct server *server, struct out *out)
{
    int routine = routine_of(server->asked + 1);
    int said = settle(server, routine);
    if (said != DONE)
        return said;
    put(out, server->asked, 3);
    put_results(server, routine, out);
    return DONE;
}

int control_routine(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    const struct routine *routine;
    int index, option;
    (void)out;
    if (size < 3)
        return INCORRECT_MESSAGE_LENGTH;
    option = data[0];
    index = routine_of(data + 1);
    if (index < 0 || !server_allows(server, routines[index].access))
        return REQUEST_OUT_OF_RANGE;
    routine = &routines[index];
    if (!server_is_open(server, routine->access))
        return SECURITY_ACCESS_DENIED;
    if (option == STOP && !routine->can_stop)
        return SUB_FUNCTION_NOT_SUPPORTED;
    if (size != 3 + (option == START ? (size_t)routine->arguments.size : 0))
        return INCORRECT_MESSAGE_LENGTH;
    if (option == START) {
        if (!may_be_written(&routine->arguments, data + 3))
            return REQUEST_OUT_OF_RANGE;
        if (server->programmes[index].state == RUNNING)
            return REQUEST_SEQUENCE_ERROR;
        if (!may_start(server, index))
            return CONDITIONS_NOT_CORRECT;
        if (index == ROUTINE_RESTORE_SET_UP && store_is_busy(server->computer.memory.store))
            return BUSY_REPEAT_REQUEST; /* what wrote it before is not done */
        start(server, index, data + 3);
    } else if (option == STOP) {
        if (!can_be_stopped(server, index))
            return REQUEST_SEQUENCE_ERROR;
        stop(server, index, false);
    } else if (server->programmes[index].state == NEVER_STARTED) {
        return REQUEST_SEQUENCE_ERROR;
    }
    memcpy(server->asked, data, sizeof server->asked);
    server->poll = poll_routine;
    return LATER;
}
