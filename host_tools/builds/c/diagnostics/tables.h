/* The diagnostic table in C: its types. `rrins build` writes the contents, rrins_diagnostics.c. */
#ifndef TABLES_H
#define TABLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "rrins_diagnostics.h"

enum format {
    FORMAT_U8, FORMAT_U16, FORMAT_U24, FORMAT_U32, FORMAT_U64,
    FORMAT_I8, FORMAT_I16, FORMAT_I32, FORMAT_I64,
    FORMAT_F32, FORMAT_F64, FORMAT_ASCII
};

/* A number in memory. */
enum kind { KIND_U1, KIND_U2, KIND_U4, KIND_I8, KIND_F8 };

enum origin {
    FROM_NOWHERE,     /* written or computed */
    FROM_MEMORY,      /* at an offset */
    FROM_LAST_SECOND, /* of a history */
    FROM_SPECIAL      /* computed by `special_value` */
};

struct field {
    enum format format;
    uint16_t count;
    uint64_t choices; /* numbers that may be written, one bit each; 0: any */
    double minimum, maximum;
    enum origin origin;
    enum kind kind;
    uint32_t offset;
    uint16_t available, stride; /* values in memory; the others are 0 */
    double factor; /* multiplies floats of the memory, divides those of a history */
    int64_t add;   /* to integers */
    enum special special;
    uint32_t history_count, second_bytes, seconds; /* offset, of a row, rows */
};

struct layout {
    const struct field *fields;
    uint16_t count, size;
};

/* Bit 1 to 3: sessions; bit 7: after SecurityAccess. 0: never. */
enum { ACCESS_SECURED = 0x80 };

struct identifier {
    uint16_t number;
    uint8_t read, write, control;
    int16_t parameter; /* index, or -1 */
    struct layout layout;
};

/* The parameters stand in the order of their numbers. */
struct parameter {
    const struct identifier *identifier;
    bool present;           /* whether this computer has it */
    const uint8_t *set_up; /* its data record by the set-up, if present */
};

struct subfunction {
    uint8_t number, access; /* of its own, if not 0 */
};

struct service {
    uint8_t number, access, subfunction_count;
    const struct subfunction *subfunctions;
};

struct routine {
    uint16_t number;
    uint8_t access;
    bool can_stop;
    struct layout arguments, results;
};

struct trouble {
    uint32_t number;
    uint8_t kind, bit;
    bool supported;
    int8_t parity_row, parity_kind; /* -1: has none */
};

struct segment {
    uint32_t whole, own, size; /* offsets in the memory with room for everything, and in this one */
};

/* A stretch of the memory at power-on that a choice of the set-up changes. */
struct patch {
    uint32_t offset, size;
    const uint8_t *bytes;
};

struct choice {
    uint8_t method, height_channel;
    const struct patch *patches;
    uint16_t count;
};

extern const struct identifier identifiers[IDENTIFIERS]; /* by number */
extern const struct parameter parameters[PARAMETERS];
extern const struct service services[SERVICES];
extern const struct routine routines[ROUTINES]; /* in the order of `enum routine_index` */
extern const struct trouble troubles[TROUBLES];
extern const struct identifier *const snapshot_identifiers[SNAPSHOT_IDENTIFIERS];
extern const struct layout snapshot_layouts[SNAPSHOT_IDENTIFIERS];
extern const struct identifier *const parity_identifiers[2];
extern const struct layout parity_layouts[2];
extern const struct segment memory_segments[MEMORY_SEGMENTS];
extern const struct choice choices[CHOICES];
extern const char *const identity[IDENTITIES];
extern const uint16_t silenced_ids[SILENCED_IDS];
extern const uint8_t silenced_types[SILENCED_IDS];
/* Of both kinds of sensors. */
extern const double input_axes[2][SENSORS][3], transverse_u[2][SENSORS][3],
    transverse_v[2][SENSORS][3];

#endif
