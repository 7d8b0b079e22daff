/*
 * The UDS server of the navigation computer (ISO 14229), which answers what the diagnostic table
 * says, in the order of checks of `rrins.firmware_py.diagnostics.server`.
 */
#ifndef UDS_H
#define UDS_H

#include "isotp.h"
#include "store.h"
#include "rrins_firmware.h"
#include "tables.h"

enum reset { RESET_NONE, RESET_HARD = 1, RESET_SOFT = 3 };
/* What a service or a poll says; a negative response code otherwise. */
enum { DONE = 0, LATER = -1 };

/* A response in preparation. */
struct out {
    size_t size;
    bool is_too_long;
    uint8_t at[MESSAGE_CAPACITY + 1];
};

static inline void put(struct out *out, const void *data, size_t size)
{
    const uint8_t *from = data;
    if (out->size + size > MESSAGE_CAPACITY) {
        out->is_too_long = true;
        return;
    }
    for (size_t k = 0; k < size; k++)
        out->at[out->size++] = from[k];
}

/* Big-endian. */
static inline void put_number(struct out *out, uint64_t value, unsigned size)
{
    uint8_t at[8];
    for (unsigned k = 0; k < size; k++)
        at[k] = (uint8_t)(value >> 8 * (size - 1 - k));
    put(out, at, size);
}

static inline uint64_t number_at(const uint8_t *at, size_t size)
{
    uint64_t value = 0;
    for (size_t k = 0; k < size; k++)
        value = value << 8 | at[k];
    return value;
}

void put_f32(struct out *out, double value);
void put_f64(struct out *out, double value);
double f64_at(const uint8_t *at);

uint32_t crc32_of(const uint8_t *at, size_t size);
/* The first KEY_SIZE bytes of the HMAC-SHA-256 of the seed. */
void key_of(const uint8_t seed[SEED_SIZE], uint8_t key[KEY_SIZE]);
/* Unpredictable bytes; false if there are none. */
bool random_bytes(uint8_t *at, size_t size);

/* Where a parameter's record stands among those in the memory. */
struct stored {
    bool is_there[PARAMETERS];
    uint8_t records[PARAMETERS][PARAMETER_SIZE];
};

struct parameter_memory {
    struct store *store; /* NULL: they last until the program ends */
    struct stored stored, before;
    enum condition state;
    uint64_t sequence;
    bool waits; /* whether the loop waits for the file */
    int64_t faults;
};

struct transfer {
    bool is_active, is_download;
    size_t size, done, block_size;
    uint8_t counter, block[BLOCK_LENGTH], data[CALIBRATION_CAPACITY];
};

enum routine_state { NEVER_STARTED, RUNNING, FINISHED, FAILED, STOPPED };

struct programme {
    enum routine_state state;
    bool waits; /* for the step that handles a request */
};

struct computer {
    struct rrins_firmware_ram *ram;
    struct parameter_memory memory;
    double gravity;
    uint32_t operation_cycles;
    bool are_faults_new;
};

struct server {
    struct computer computer;
    int session;
    bool is_unlocked;
    enum reset reset_wanted;
    int64_t now_ns, last_ns;
    /* the response in preparation */
    int (*poll)(struct server *, struct out *);
    uint8_t pending_service;
    bool is_wanted, is_functional;
    int64_t due_ns;
    uint8_t asked[3]; /* of the request that is pending */
    struct write_job *job;
    /* security */
    bool has_seed;
    uint8_t seed[SEED_SIZE];
    int attempts;
    int64_t closed_until_ns;
    int silent; /* stopped communication types, one bit each */
    bool is_turning[2];
    double turning_deg[2];
    struct transfer transfer;
    struct programme programmes[ROUTINES];
};

typedef int service_function(struct server *, const uint8_t *data, size_t size, struct out *out);

service_function read_data, read_memory, write_data, control_output, clear_troubles, read_troubles,
    control_routine, request_download, request_upload, transfer_data, exit_transfer;

/* server.c */
void server_power_on(struct server *server);
bool server_is_idle(const struct server *server);
/* Process a request, or advance by an epoch; whether there is a response in `out`. */
bool server_handle(struct server *server, const uint8_t *request, size_t size, bool is_functional,
                   int64_t now_ns, struct out *out);
bool server_poll(struct server *server, int64_t now_ns, struct out *out);
bool server_allows(const struct server *server, uint8_t access);
bool server_is_open(const struct server *server, uint8_t access);

/* values.c */
const struct identifier *identifier_of(uint64_t number);
void put_field(struct out *out, const struct field *field, const void *memory,
               const struct server *server);
void put_layout(struct out *out, const struct layout *layout, const void *memory,
                const struct server *server);
/* Whether the values of a record, of the layout's length, may be written. */
bool may_be_written(const struct layout *layout, const uint8_t *record);
void put_identifier(struct server *server, struct out *out, const struct identifier *did);

/* The axes, as tools command them; control.c */
void turn_axis(struct computer *computer, int axis, double target_deg);
void hold_axis(struct computer *computer, int axis);
bool is_told(const struct computer *computer, int axis, double target_deg);
bool axes_may_turn(const struct computer *computer);
void return_control(struct server *server);
int address_and_size(const uint8_t *data, size_t size, uint32_t *address, uint32_t *wanted);

/* parameters.c */
void parameters_load(struct parameter_memory *memory);
void store_record(struct stored *stored, size_t parameter, const uint8_t *record);
/* The record that a parameter has with what is stored; NULL if this computer does not have it. */
const uint8_t *value_with(const struct stored *stored, size_t parameter);
/* Write the calibration file of what is in effect after a reset; its size. */
size_t calibration_file(const struct parameter_memory *memory, uint8_t file[CALIBRATION_CAPACITY]);
/* Start storing changed parameters, or others in place of all; finish says whether that worked. */
struct write_job *parameters_change(struct parameter_memory *memory, const struct stored *changes);
struct write_job *parameters_replace(struct parameter_memory *memory, const struct stored *all);
bool parameters_finish(struct parameter_memory *memory, struct write_job *job);
/* Read a calibration file; whether all of it is valid, and this computer's. */
bool parameters_read(struct stored *stored, const uint8_t *file, size_t size);

/* set_up.c */
/* Whether the sensors can be fused with these weights, and the computer was built for the rest. */
bool weights_are_usable(const struct stored *stored, int kind);
bool is_built(const struct stored *stored);
bool can_be_set_up(const struct stored *stored);
/* Make the memory what it is at power-on with the parameters that are stored. */
void computer_power_on(struct computer *computer);

/* fault_memory.c */
void faults_begin_cycle(struct computer *computer);
void faults_begin_test(struct computer *computer);
void faults_clear(struct computer *computer, int only); /* -1: all */
int trouble_of(uint64_t number);                        /* index, or -1 */
int detection_counter(const struct computer *computer, int index);
void faults_image(const struct computer *computer, uint8_t image[FAULT_CAPACITY]);
void faults_recall(struct computer *computer, const uint8_t *image, size_t size);

/* routines.c */
bool routines_are_busy(const struct server *server);
void routines_work(struct server *server);
void routines_leave_session(struct server *server);
void routines_forget(struct server *server);

/* calibration.c: the routine `calibration` */
bool calibration_may_start(const struct computer *computer);
void calibration_start(struct server *server, const uint8_t *arguments);
void calibration_work(struct server *server);
void calibration_forget(struct server *server);
void put_calibration(const struct server *server, struct out *out);

/* table_calibration.c: the routine `table_calibration` */
void table_start(struct server *server, const uint8_t *arguments);
void table_work(struct server *server);
void table_stop(struct server *server, bool is_by_session);
void table_forget(struct server *server);
void put_table(const struct server *server, struct out *out);
size_t table_record(const uint8_t **record); /* its size, bytes */

#endif
