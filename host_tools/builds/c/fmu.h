/*
 * A side of the rehearsal as a unit of co-simulation; fmi2.c and fmi3.c are its two interfaces.
 *
 * A step of the unit is an epoch. The frames of an epoch are one string of bytes, laid out as
 * operations "CAN Transmit" of FMI-LS-BUS.
 */
#ifndef FMU_H
#define FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fmu_tables.h" /* of the side: FMU_MEMORY, FMU_TOKEN, outputs, parameters */

#define EXPORT __attribute__((visibility("default")))

/* Value references. In FMI 2.0 a string of bytes takes three: its address, low and high, its size. */
enum { FMU_TIME = 0, FMU_RECEIVED = 1, FMU_SENT = 4, FMU_OUTPUT = 8 };
enum { FMU_PARAMETER = FMU_OUTPUT + FMU_OUTPUTS, FMU_END = FMU_PARAMETER + FMU_PARAMETERS };
enum { FMU_LOW, FMU_HIGH, FMU_SIZE };

/* All that a saved state is made of. */
struct fmu_state {
    double time, parameters[FMU_PARAMETERS];
    int64_t steps;
    uint64_t received_size, sent_size;
    uint8_t received[FMU_BYTES], sent[2][FMU_BYTES]; /* what was sent last stays for another step */
    FMU_MEMORY memory;
};

struct fmu {
    struct fmu_state now;
    int32_t address[3]; /* of received bytes, in FMI 2.0 */
    const char *reason; /* of the last failure */
    void *environment, *log; /* of the interface */
};

/* All return false for a failure, with its reason. */
struct fmu *fmu_new(const char *token);
void fmu_reset(struct fmu *fmu);
bool fmu_begin(struct fmu *fmu); /* power on with the parameters as they are now */
bool fmu_step(struct fmu *fmu, double time, double length);

bool fmu_get(struct fmu *fmu, uint32_t reference, double *value);
bool fmu_get_integer(struct fmu *fmu, uint32_t reference, int64_t *value);
bool fmu_set(struct fmu *fmu, uint32_t reference, double value);
bool fmu_set_received(struct fmu *fmu, const uint8_t *bytes, size_t size);
const uint8_t *fmu_sent(const struct fmu *fmu);

bool fmu_save(struct fmu *fmu, void **state);
bool fmu_load(struct fmu *fmu, const void *state);
bool fmu_copy_state(struct fmu *fmu, void *to, const void *from, size_t size);

#endif
