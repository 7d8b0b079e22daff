/* The parameters in effect: from the memory, or from the set-up where the memory has none. */
#include <string.h>

#include "uds.h"

enum { HEAD_SIZE = 8, ENTRY_SIZE = 4, CRC_SIZE = 4, FILE_VERSION = 1 };

static const char magic[4] = {'R', 'R', 'C', 'A'};

static size_t size_of(size_t parameter)
{
    return parameters[parameter].identifier->layout.size;
}

void store_record(struct stored *stored, size_t parameter, const uint8_t *record)
{
    stored->is_there[parameter] = true;
    memcpy(stored->records[parameter], record, size_of(parameter));
}

const uint8_t *value_with(const struct stored *stored, size_t parameter)
{
    return stored->is_there[parameter]    ? stored->records[parameter]
           : parameters[parameter].present ? parameters[parameter].set_up
                                          : NULL;
}

/* Write the calibration file of parameters; with those of the set-up if `is_whole`. */
static size_t encode(const struct stored *stored, bool is_whole, uint8_t *file)
{
    size_t size = HEAD_SIZE, count = 0;
    struct out number = {.size = 0};
    for (size_t k = 0; k < PARAMETERS; k++) {
        const uint8_t *record = value_with(stored, k);
        if (record == NULL || !(is_whole || stored->is_there[k]))
            continue;
        number.size = 0;
        put_number(&number, parameters[k].identifier->number, 2);
        put_number(&number, size_of(k), 2);
        memcpy(file + size, number.at, ENTRY_SIZE);
        memcpy(file + size + ENTRY_SIZE, record, size_of(k));
        size += ENTRY_SIZE + size_of(k);
        count++;
    }
    number.size = 0;
    put(&number, magic, sizeof magic);
    put_number(&number, FILE_VERSION, 2);
    put_number(&number, count, 2);
    memcpy(file, number.at, HEAD_SIZE);
    number.size = 0;
    put_number(&number, crc32_of(file, size), CRC_SIZE);
    memcpy(file + size, number.at, CRC_SIZE);
    return size + CRC_SIZE;
}

size_t calibration_file(const struct parameter_memory *memory, uint8_t file[CALIBRATION_CAPACITY])
{
    return encode(&memory->stored, true, file);
}

static int parameter_of(uint64_t number)
{
    const struct identifier *did = identifier_of(number);
    return did == NULL ? -1 : did->parameter;
}

/* Whether the entries fill a file and none is there twice. */
static bool is_sound(const uint8_t *file, size_t end)
{
    static uint8_t seen[65536 / 8];
    size_t count = 0;
    memset(seen, 0, sizeof seen);
    for (size_t at = HEAD_SIZE; at < end; count++) {
        uint64_t number;
        if (at + ENTRY_SIZE > end)
            return false;
        number = number_at(file + at, 2);
        if ((seen[number / 8] >> number % 8 & 1) != 0)
            return false;
        seen[number / 8] |= (uint8_t)(1U << number % 8);
        at += ENTRY_SIZE + number_at(file + at + 2, 2);
        if (at > end)
            return false;
    }
    return count == number_at(file + 6, 2);
}

/* Read the valid entries of a calibration file; whether all are. False if it is none. */
static bool decode(struct stored *stored, const uint8_t *file, size_t size)
{
    size_t end = size - CRC_SIZE;
    bool is_whole = true;
    memset(stored, 0, sizeof *stored);
    if (size < HEAD_SIZE + CRC_SIZE || memcmp(file, magic, sizeof magic) != 0 ||
        number_at(file + end, CRC_SIZE) != crc32_of(file, end) ||
        number_at(file + 4, 2) != FILE_VERSION || !is_sound(file, end))
        return false;
    for (size_t at = HEAD_SIZE; at < end; at += ENTRY_SIZE + number_at(file + at + 2, 2)) {
        int parameter = parameter_of(number_at(file + at, 2));
        const uint8_t *record = file + at + ENTRY_SIZE;
        if (parameter >= 0 && number_at(file + at + 2, 2) == size_of((size_t)parameter) &&
            may_be_written(&parameters[parameter].identifier->layout, record))
            store_record(stored, (size_t)parameter, record);
        else
            is_whole = false;
    }
    return is_whole;
}

bool parameters_read(struct stored *stored, const uint8_t *file, size_t size)
{
    if (!decode(stored, file, size))
        return false;
    for (size_t k = 0; k < PARAMETERS; k++)
        if (stored->is_there[k] && !parameters[k].present)
            return false;
    return true;
}

/* Leave out one choice that the program has no room for; both if either is too much. */
static void drop_what_is_not_built(struct stored *stored)
{
    static const size_t which[] = {P_ALIGNMENT, P_HEIGHT_CHANNEL};
    for (size_t k = 0; k < 2; k++) {
        bool was_there = stored->is_there[which[k]];
        stored->is_there[which[k]] = false;
        if (is_built(stored))
            return;
        stored->is_there[which[k]] = was_there;
    }
    stored->is_there[P_ALIGNMENT] = stored->is_there[P_HEIGHT_CHANNEL] = false;
}

void parameters_load(struct parameter_memory *memory)
{
    static uint8_t file[CALIBRATION_CAPACITY];
    static const int64_t faults[] = {0, 0, INT64_C(1) << FAULT_COPY_DAMAGED,
                                     INT64_C(1) << FAULT_PARAMETERS_LOST};
    bool is_whole = true;
    size_t size;
    if (memory->store == NULL)
        return;
    memory->state = store_read(memory->store, file, &size, &memory->sequence);
    memory->faults = faults[memory->state];
    memset(&memory->stored, 0, sizeof memory->stored);
    if (memory->state == MEMORY_WHOLE || memory->state == MEMORY_ONE_DAMAGED)
        is_whole = decode(&memory->stored, file, size);
    for (int kind = 0; kind < 2; kind++)
        if (!weights_are_usable(&memory->stored, kind)) {
            memory->stored.is_there[kind == 0 ? P_GYRO_WEIGHTS : P_ACCELEROMETER_WEIGHTS] = false;
            is_whole = false;
        }
    if (!is_built(&memory->stored)) {
        drop_what_is_not_built(&memory->stored);
        is_whole = false;
    }
    if (!is_whole)
        memory->faults |= INT64_C(1) << FAULT_OUT_OF_LIMITS;
}

struct write_job *parameters_replace(struct parameter_memory *memory, const struct stored *all)
{
    static uint8_t file[CALIBRATION_CAPACITY];
    memory->before = memory->stored;
    memory->stored = *all;
    if (memory->store == NULL)
        return no_write_job();
    return store_write(memory->store, file, encode(&memory->stored, false, file), memory->waits);
}

bool parameters_finish(struct parameter_memory *memory, struct write_job *job)
{
    if (job->has_failed)
        memory->stored = memory->before;
    return !job->has_failed;
}

/* Whether what lasts of a sensor's calibration is changed. */
static bool lasting_differ(const uint8_t *former, const uint8_t *values)
{
    for (size_t at = LASTING_BEGIN; at < LASTING_END; at += sizeof(double))
        if (f64_at(former + at) < f64_at(values + at) || f64_at(former + at) > f64_at(values + at))
            return true;
    return false;
}

/* Add what changes make unknown of the calibration's origin. */
static void forget_origin(const struct stored *before, struct stored *changes)
{
    static const size_t constants[] = {P_GYRO_CALIBRATION, P_ACCELEROMETER_CALIBRATION};
    static const size_t sigmas[] = {P_GYRO_SIGMA, P_ACCELEROMETER_SIGMA};
    static const uint8_t unknown[PARAMETER_SIZE];
    bool is_dated = changes->is_there[P_CALIBRATED];
    for (size_t kind = 0; kind < 2; kind++)
        for (size_t k = 0; k < SENSORS; k++) {
            const uint8_t *former = value_with(before, constants[kind] + k);
            if (!changes->is_there[constants[kind] + k] || former == NULL ||
                !lasting_differ(former, changes->records[constants[kind] + k]))
                continue;
            if (!changes->is_there[sigmas[kind] + k])
                store_record(changes, sigmas[kind] + k, unknown);
            if (!is_dated)
                store_record(changes, P_CALIBRATED, unknown);
        }
}

struct write_job *parameters_change(struct parameter_memory *memory, const struct stored *changes)
{
    static struct stored all, found;
    found = *changes;
    forget_origin(&memory->stored, &found);
    all = memory->stored;
    for (size_t k = 0; k < PARAMETERS; k++)
        if (found.is_there[k])
            store_record(&all, k, found.records[k]);
    return parameters_replace(memory, &all);
}
