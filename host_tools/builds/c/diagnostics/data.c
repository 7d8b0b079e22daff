/* Data transmission, 0x22, 0x23 and 0x2E, and input-output control, 0x2F. */
#include <math.h>
#include <string.h>

#include "uds.h"

enum { RETURN_CONTROL, RESET_TO_DEFAULT, FREEZE, ADJUST };

/* An identifier that this computer has, or NULL. */
static const struct identifier *known(const uint8_t *at)
{
    const struct identifier *did = identifier_of(number_at(at, 2));
    return did != NULL && did->parameter >= 0 && !parameters[did->parameter].present ? NULL : did;
}

int read_data(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    const struct identifier *found[MOST_IDENTIFIERS];
    size_t count = 0;
    if (size < 2 || size % 2 != 0 || size > 2 * MOST_IDENTIFIERS)
        return INCORRECT_MESSAGE_LENGTH;
    for (size_t k = 0; k < size; k += 2) {
        const struct identifier *did = known(data + k);
        if (did != NULL && server_allows(server, did->read))
            found[count++] = did;
    }
    if (count == 0)
        return REQUEST_OUT_OF_RANGE;
    for (size_t k = 0; k < count; k++)
        if (!server_is_open(server, found[k]->read))
            return SECURITY_ACCESS_DENIED;
    for (size_t k = 0; k < count; k++) {
        put_number(out, found[k]->number, 2);
        put_identifier(server, out, found[k]);
    }
    return out->is_too_long ? RESPONSE_TOO_LONG : DONE;
}

int address_and_size(const uint8_t *data, size_t size, uint32_t *address, uint32_t *wanted)
{
    size_t size_bytes = data[0] >> 4, address_bytes = data[0] & 0xF;
    if (size_bytes < 1 || size_bytes > 4 || address_bytes < 1 || address_bytes > 4)
        return REQUEST_OUT_OF_RANGE;
    if (size != 1 + address_bytes + size_bytes)
        return INCORRECT_MESSAGE_LENGTH;
    *address = (uint32_t)number_at(data + 1, address_bytes);
    *wanted = (uint32_t)number_at(data + 1 + address_bytes, size_bytes);
    return DONE;
}

/* Put memory by the addresses of one that has room for everything. */
static void put_memory(struct out *out, const uint8_t *memory, uint32_t start, uint32_t size)
{
    static uint8_t found[MESSAGE_CAPACITY];
    memset(found, 0, size);
    for (size_t k = 0; k < MEMORY_SEGMENTS; k++) {
        const struct segment *one = &memory_segments[k];
        uint32_t low = one->whole > start ? one->whole : start, high = one->whole + one->size;
        high = high < start + size ? high : start + size;
        if (low < high)
            memcpy(found + (low - start), memory + one->own + (low - one->whole), high - low);
    }
    put(out, found, size);
}

int read_memory(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    const uint8_t *record;
    size_t record_size = table_record(&record);
    uint32_t start, wanted;
    bool is_record;
    int said;
    if (size < 3)
        return INCORRECT_MESSAGE_LENGTH;
    said = address_and_size(data, size, &start, &wanted);
    if (said != DONE)
        return said;
    is_record = start >= RECORD_ADDRESS;
    start -= is_record ? RECORD_ADDRESS : 0;
    if (wanted == 0 || (uint64_t)start + wanted > (is_record ? record_size : MEMORY_BYTES))
        return REQUEST_OUT_OF_RANGE;
    if (wanted >= MESSAGE_CAPACITY)
        return RESPONSE_TOO_LONG;
    if (is_record)
        put(out, record + start, wanted);
    else
        put_memory(out, (const uint8_t *)server->computer.ram, start, wanted);
    return DONE;
}

static int poll_write(struct server *server, struct out *out)
{
    struct parameter_memory *memory = &server->computer.memory;
    if (!write_job_is_done(server->job))
        return LATER;
    if (!parameters_finish(memory, server->job))
        return GENERAL_PROGRAMMING_FAILURE;
    put(out, server->asked, 2);
    return DONE;
}

int write_data(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    static struct stored changes, whole;
    const struct identifier *did;
    (void)out;
    if (size < 3)
        return INCORRECT_MESSAGE_LENGTH;
    did = known(data);
    if (did == NULL || did->write == 0 || !server_allows(server, did->write))
        return REQUEST_OUT_OF_RANGE;
    if (!server_is_open(server, did->write))
        return SECURITY_ACCESS_DENIED;
    if (size != 2 + (size_t)did->layout.size)
        return INCORRECT_MESSAGE_LENGTH;
    if (!may_be_written(&did->layout, data + 2))
        return REQUEST_OUT_OF_RANGE;
    memset(&changes, 0, sizeof changes);
    whole = server->computer.memory.stored;
    store_record(&changes, (size_t)did->parameter, data + 2);
    store_record(&whole, (size_t)did->parameter, data + 2);
    if (!can_be_set_up(&whole))
        return REQUEST_OUT_OF_RANGE;
    if (store_is_busy(server->computer.memory.store))
        return BUSY_REPEAT_REQUEST; /* what wrote it before is not done */
    server->job = parameters_change(&server->computer.memory, &changes);
    memcpy(server->asked, data, 2);
    server->poll = poll_write;
    return LATER;
}

static void command(struct computer *computer, int axis, int64_t command, double target_deg)
{
    computer->ram->sequencer.command[axis] = command;
    computer->ram->sequencer.target_angle_deg[axis] = target_deg;
}

void turn_axis(struct computer *computer, int axis, double target_deg)
{
    command(computer, axis, COMMAND_POSITION, target_deg);
}

void hold_axis(struct computer *computer, int axis)
{
    command(computer, axis, COMMAND_HOLD, computer->ram->assembly.encoder_angle_deg[axis]);
}

bool is_told(const struct computer *computer, int axis, double target_deg)
{
    double told = computer->ram->sequencer.target_angle_deg[axis];
    double largest = fmax(fabs(told), fabs(target_deg));
    return computer->ram->sequencer.command[axis] == COMMAND_POSITION &&
           fabs(told - target_deg) <= 1e-9 * largest;
}

bool axes_may_turn(const struct computer *computer)
{
    int64_t mode = computer->ram->modes.mode;
    return mode == RRINS_MODE_STANDBY || mode == RRINS_MODE_FAULT ||
           mode == RRINS_MODE_NAVIGATION_STRAPDOWN;
}

/* Make an axis hold, unless the computer has commanded something else since. */
static void return_axis(struct server *server, int axis)
{
    struct computer *computer = &server->computer;
    if (server->is_turning[axis] && is_told(computer, axis, server->turning_deg[axis]) &&
        axes_may_turn(computer))
        hold_axis(computer, axis);
    server->is_turning[axis] = false;
}

void return_control(struct server *server)
{
    return_axis(server, 0);
    return_axis(server, 1);
    server->computer.ram->diagnostics.excluded_gyros = 0;
    server->computer.ram->diagnostics.excluded_accelerometers = 0;
}

static int exclude(struct rrins_firmware_ram *ram, int64_t gyros, int64_t accelerometers)
{
    if (gyros >> ram->gyros.count != 0 || accelerometers >> ram->accelerometers.count != 0)
        return REQUEST_OUT_OF_RANGE;
    ram->diagnostics.excluded_gyros = gyros;
    ram->diagnostics.excluded_accelerometers = accelerometers;
    return DONE;
}

static int control_axis(struct server *server, int axis, int option, double target_deg)
{
    struct computer *computer = &server->computer;
    if (option == RETURN_CONTROL) {
        return_axis(server, axis);
        return DONE;
    }
    if (!axes_may_turn(computer))
        return CONDITIONS_NOT_CORRECT;
    if (option == FREEZE) {
        hold_axis(computer, axis);
        server->is_turning[axis] = false;
        return DONE;
    }
    turn_axis(computer, axis, target_deg);
    server->is_turning[axis] = true;
    server->turning_deg[axis] = target_deg;
    return DONE;
}

int control_output(struct server *server, const uint8_t *data, size_t size, struct out *out)
{
    const struct identifier *did;
    const uint8_t *record = data + 3;
    int option, said = DONE;
    if (size < 3)
        return INCORRECT_MESSAGE_LENGTH;
    did = identifier_of(number_at(data, 2));
    option = data[2];
    if (did == NULL || did->control == 0 || !server_allows(server, did->control) ||
        option > ADJUST)
        return REQUEST_OUT_OF_RANGE;
    if (!server_is_open(server, did->control))
        return SECURITY_ACCESS_DENIED;
    if (size != 3 + (option == ADJUST ? (size_t)did->layout.size : 0))
        return INCORRECT_MESSAGE_LENGTH;
    if (option == ADJUST && !may_be_written(&did->layout, record))
        return REQUEST_OUT_OF_RANGE;
    if (did->number == DID_EXCLUDED_SENSORS) {
        struct rrins_firmware_ram *ram = server->computer.ram;
        if (option == ADJUST)
            said = exclude(ram, (int64_t)number_at(record, 2), (int64_t)number_at(record + 2, 2));
        else if (option != FREEZE)
            said = exclude(ram, 0, 0);
    } else {
        said = control_axis(server, did->number == DID_AXIS_OUTER_CONTROL, option,
                            option == ADJUST ? f64_at(record) : 0.0);
    }
    if (said != DONE)
        return said;
    put(out, data, 3);
    put_identifier(server, out, did);
    return DONE;
}
