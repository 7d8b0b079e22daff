/* Values in data records, big-endian and consecutive, from memory and back. */
#include <math.h>
#include <string.h>

#include "uds.h"

void put_f32(struct out *out, double value)
{
    float single = (float)value;
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    put_number(out, bits, sizeof bits);
}

void put_f64(struct out *out, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_number(out, bits, sizeof bits);
}

double f64_at(const uint8_t *at)
{
    uint64_t bits = number_at(at, sizeof bits);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static const unsigned sizes[] = {1, 2, 3, 4, 8, 1, 2, 4, 8, 4, 8, 1};
static const unsigned kind_sizes[] = {1, 2, 4, 8, 8};

static bool is_float(const struct field *field)
{
    return field->format == FORMAT_F32 || field->format == FORMAT_F64;
}

static void put_float(struct out *out, const struct field *field, double value)
{
    if (field->format == FORMAT_F32)
        put_f32(out, value);
    else
        put_f64(out, value);
}

/* Put an integer, clipped to the range of the format. */
static void put_integer(struct out *out, const struct field *field, int64_t value)
{
    unsigned size = sizes[field->format];
    bool is_signed = field->format >= FORMAT_I8;
    int64_t low = 0, high = INT64_MAX;
    if (size < 8) {
        high = (INT64_C(1) << (8 * size - is_signed)) - 1;
        low = is_signed ? -high - 1 : 0;
    } else if (is_signed) {
        low = INT64_MIN;
    }
    value = value < low ? low : value > high ? high : value;
    put_number(out, (uint64_t)value, size);
}

static int64_t integer_at(enum kind kind, const uint8_t *at)
{
    uint64_t value = 0;
    for (unsigned k = 0; k < kind_sizes[kind]; k++)
        value |= (uint64_t)at[k] << 8 * k;
    return (int64_t)value;
}

static double float_at(const uint8_t *at)
{
    int64_t bits = integer_at(KIND_F8, at);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void put_memory(struct out *out, const struct field *field, const uint8_t *memory)
{
    static const uint8_t nothing[8];
    const uint8_t *at = memory + field->offset;
    for (unsigned k = 0; k < field->count; k++) {
        const uint8_t *one = k < field->available ? at + k * field->stride : nothing;
        bool is_double = field->kind == KIND_F8;
        if (is_float(field)) {
            double value = is_double ? float_at(one) : (double)integer_at(field->kind, one);
            put_float(out, field, value * field->factor);
        } else {
            int64_t value = is_double ? (int64_t)float_at(one) : integer_at(field->kind, one);
            put_integer(out, field, value + field->add);
        }
    }
}

/* Put what the last second of a history came to. */
static void put_last(struct out *out, const struct field *field, const uint8_t *memory)
{
    int64_t count = integer_at(KIND_I8, memory + field->history_count);
    int64_t last = (count - 1) % field->seconds;
    const uint8_t *second;
    last += last < 0 ? field->seconds : 0;
    second = memory + field->offset + (size_t)last * field->second_bytes;
    for (unsigned k = 0; k < field->count; k++) {
        double value = k < field->available ? float_at(second + k * field->stride) : 0.0;
        put_float(out, field, value / field->factor);
    }
}

static void put_text(struct out *out, const struct field *field, const char *text)
{
    size_t length = strlen(text);
    for (unsigned k = 0; k < field->count; k++)
        put(out, k < length ? text + k : " ", 1);
}

/* Put a value that is computed. */
static void put_special(struct out *out, const struct field *field, const struct server *server)
{
    const struct computer *computer = &server->computer;
    const struct rrins_firmware_ram *ram = computer->ram;
    static uint8_t file[CALIBRATION_CAPACITY];
    double found[DERIVED];
    rrins_firmware_derive(computer->ram, found);
    switch (field->special) {
    case SPECIAL_SESSION:
        put_integer(out, field, server->session);
        break;
    case SPECIAL_TABLE_CRC32:
        put_integer(out, field, TABLE_CRC32);
        break;
    case SPECIAL_ERROR_PPM:
        put_float(out, field, found[DERIVED_ERROR_PPM]);
        break;
    case SPECIAL_BUS_LOAD_PERCENT:
        put_float(out, field,
                  100.0 * ram->diagnostics.frames_mean / ram->diagnostics.frames_capacity);
        break;
    case SPECIAL_UPTIME_S:
        put_float(out, field, (double)(ram->steps * PERIOD_NS) * 1e-9);
        break;
    case SPECIAL_STATE:
        put_integer(out, field, computer->memory.state);
        break;
    case SPECIAL_SEQUENCE:
        put_integer(out, field, (int64_t)(computer->memory.sequence & 0xFFFFFFFF));
        break;
    case SPECIAL_PARAMETERS: {
        int64_t count = 0;
        for (size_t k = 0; k < PARAMETERS; k++)
            count += computer->memory.stored.is_there[k];
        put_integer(out, field, count);
        break;
    }
    case SPECIAL_RESIDUAL_DPH:
        for (unsigned k = 0; k < field->count; k++)
            put_float(out, field, ram->diagnostics.gyro_residual[k] / (DPH * PERIOD_NS * 1e-9));
        break;
    case SPECIAL_RESIDUAL_UG:
        for (unsigned k = 0; k < field->count; k++)
            put_float(out, field,
                      ram->diagnostics.accelerometer_residual[k] / (UG * PERIOD_NS * 1e-9));
        break;
    case SPECIAL_HORIZONTAL_PROTECTION_M:
        put_float(out, field, fmin(ram->integrity.protection[0], NO_BOUND));
        break;
    case SPECIAL_VERTICAL_PROTECTION_M:
        put_float(out, field, fmin(ram->integrity.protection[1], NO_BOUND));
        break;
    case SPECIAL_HEADING_PROTECTION_DEG:
        put_float(out, field, fmin(ram->integrity.protection[2] / DEGREE, NO_BOUND));
        break;
    case SPECIAL_NIS:
        for (unsigned k = 0; k < field->count; k++)
            put_float(out, field,
                      ram->estimator.sources[k].squares /
                          (double)(ram->estimator.sources[k].used > 1
                                       ? ram->estimator.sources[k].used : 1));
        break;
    case SPECIAL_OPERATION_CYCLES:
        put_integer(out, field, computer->operation_cycles);
        break;
    case SPECIAL_LENGTH:
        put_integer(out, field, (int64_t)calibration_file(&computer->memory, file));
        break;
    case SPECIAL_FILE_CRC32:
        put_integer(out, field,
                    crc32_of(file, calibration_file(&computer->memory, file)));
        break;
    case SPECIAL_SUPPLIER:
    case SPECIAL_SERIAL_NUMBER:
    case SPECIAL_HARDWARE_NUMBER:
    case SPECIAL_SOFTWARE_NUMBER:
    case SPECIAL_SOFTWARE_VERSION:
    case SPECIAL_SYSTEM_NAME:
        put_text(out, field, identity[field->special - SPECIAL_SUPPLIER]);
        break;
    }
}

void put_field(struct out *out, const struct field *field, const void *memory,
               const struct server *server)
{
    if (field->origin == FROM_MEMORY)
        put_memory(out, field, memory);
    else if (field->origin == FROM_LAST_SECOND)
        put_last(out, field, memory);
    else if (field->origin == FROM_SPECIAL)
        put_special(out, field, server);
}

void put_layout(struct out *out, const struct layout *layout, const void *memory,
                const struct server *server)
{
    for (size_t k = 0; k < layout->count; k++)
        put_field(out, &layout->fields[k], memory, server);
}

void put_identifier(struct server *server, struct out *out, const struct identifier *did)
{
    const struct computer *computer = &server->computer;
    if (did->parameter >= 0)
        put(out, value_with(&computer->memory.stored, (size_t)did->parameter), did->layout.size);
    else
        put_layout(out, &did->layout, computer->ram, server);
}

static bool is_allowed(const struct field *field, double value)
{
    if (!isfinite(value))
        return false;
    if (field->choices != 0 &&
        (value < 0.0 || value > 63.0 || (field->choices >> (unsigned)value & 1) == 0))
        return false;
    return value >= field->minimum && value <= field->maximum;
}

bool may_be_written(const struct layout *layout, const uint8_t *record)
{
    for (size_t k = 0; k < layout->count; k++) {
        const struct field *field = &layout->fields[k];
        unsigned size = sizes[field->format];
        for (unsigned one = 0; one < field->count; one++, record += size) {
            double value;
            if (field->format == FORMAT_F64)
                value = f64_at(record);
            else /* nothing that is written has another format, `rrins build` sees to that */
                value = (double)number_at(record, size);
            if (!is_allowed(field, value))
                return false;
        }
    }
    return true;
}

const struct identifier *identifier_of(uint64_t number)
{
    size_t low = 0, high = IDENTIFIERS;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (identifiers[middle].number < number)
            low = middle + 1;
        else
            high = middle;
    }
    return low < IDENTIFIERS && identifiers[low].number == number ? &identifiers[low] : NULL;
}
