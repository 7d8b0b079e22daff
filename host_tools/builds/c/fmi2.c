/* The interface of FMI 2.0 (https://fmi-standard.org), co-simulation. */
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "fmu.h"

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } status;
typedef void (*log_message)(void *environment, const char *name, status how, const char *category,
                            const char *text, ...);
struct callbacks {
    log_message log;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, status how);
    void *environment;
};

static status answer(struct fmu *fmu, bool is_well)
{
    if (!is_well && fmu->log != NULL)
        ((log_message)fmu->log)(fmu->environment, FMU_NAME, ERROR, "logStatusError", "%s",
                                fmu->reason);
    return is_well ? OK : ERROR;
}

EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *token, const char *resources,
                             const struct callbacks *callbacks, int visible, int logging)
{
    enum { CO_SIMULATION = 1 };
    struct fmu *fmu = type == CO_SIMULATION ? fmu_new(token) : NULL;
    (void)name, (void)resources, (void)visible, (void)logging;
    if (fmu != NULL && callbacks != NULL) {
        fmu->environment = callbacks->environment;
        fmu->log = (void *)callbacks->log;
    }
    return fmu;
}

EXPORT void fmi2FreeInstance(void *fmu)
{
    free(fmu);
}

EXPORT status fmi2SetDebugLogging(void *fmu, int on, size_t count, const char *const *categories)
{
    (void)fmu, (void)on, (void)count, (void)categories;
    return OK;
}

EXPORT status fmi2SetupExperiment(struct fmu *fmu, int has_tolerance, double tolerance,
                                  double start, int has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    fmu->now.time = start;
    return OK;
}

EXPORT status fmi2EnterInitializationMode(void *fmu)
{
    (void)fmu;
    return OK;
}

EXPORT status fmi2ExitInitializationMode(struct fmu *fmu)
{
    return answer(fmu, fmu_begin(fmu));
}

EXPORT status fmi2Terminate(void *fmu)
{
    (void)fmu;
    return OK;
}

EXPORT status fmi2Reset(struct fmu *fmu)
{
    fmu_reset(fmu);
    return OK;
}

EXPORT status fmi2DoStep(struct fmu *fmu, double time, double length, int keeps)
{
    (void)keeps;
    return answer(fmu, fmu_step(fmu, time, length));
}

EXPORT status fmi2GetReal(struct fmu *fmu, const uint32_t *references, size_t count, double *values)
{
    bool is_well = true;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = fmu_get(fmu, references[k], &values[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi2SetReal(struct fmu *fmu, const uint32_t *references, size_t count,
                          const double *values)
{
    bool is_well = true;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = fmu_set(fmu, references[k], values[k]);
    return answer(fmu, is_well);
}

/* An integer of 64 bits as one of 32; bytes as their address and size. */
static bool get(struct fmu *fmu, uint32_t reference, int *value)
{
    int64_t whole;
    uintptr_t at = (uintptr_t)fmu_sent(fmu);
    if (reference >= FMU_RECEIVED && reference <= FMU_RECEIVED + FMU_SIZE)
        *value = fmu->address[reference - FMU_RECEIVED];
    else if (reference == FMU_SENT + FMU_LOW)
        *value = (int)(uint32_t)at;
    else if (reference == FMU_SENT + FMU_HIGH)
        *value = (int)(uint32_t)((uint64_t)at >> 32);
    else if (reference == FMU_SENT + FMU_SIZE)
        *value = (int)fmu->now.sent_size;
    else if (fmu_get_integer(fmu, reference, &whole))
        *value = whole > INT_MAX ? INT_MAX : whole < INT_MIN ? INT_MIN : (int)whole;
    else
        return false;
    return true;
}

EXPORT status fmi2GetInteger(struct fmu *fmu, const uint32_t *references, size_t count, int *values)
{
    bool is_well = true;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = get(fmu, references[k], &values[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi2SetInteger(struct fmu *fmu, const uint32_t *references, size_t count,
                             const int *values)
{
    bool is_well = true;
    for (size_t k = 0; is_well && k < count; k++)
        if (references[k] >= FMU_RECEIVED && references[k] <= FMU_RECEIVED + FMU_SIZE)
            fmu->address[references[k] - FMU_RECEIVED] = values[k];
        else
            is_well = fmu_set(fmu, references[k], values[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi2GetFMUstate(struct fmu *fmu, void **state)
{
    return answer(fmu, fmu_save(fmu, state));
}

EXPORT status fmi2SetFMUstate(struct fmu *fmu, const void *state)
{
    return answer(fmu, fmu_load(fmu, state));
}

EXPORT status fmi2FreeFMUstate(void *fmu, void **state)
{
    (void)fmu;
    free(*state);
    *state = NULL;
    return OK;
}

EXPORT status fmi2SerializedFMUstateSize(void *fmu, const void *state, size_t *size)
{
    (void)fmu, (void)state;
    *size = sizeof(struct fmu_state);
    return OK;
}

EXPORT status fmi2SerializeFMUstate(struct fmu *fmu, const void *state, char *bytes, size_t size)
{
    return answer(fmu, fmu_copy_state(fmu, bytes, state, size));
}

EXPORT status fmi2DeSerializeFMUstate(struct fmu *fmu, const char *bytes, size_t size, void **state)
{
    return answer(fmu, fmu_save(fmu, state) && fmu_copy_state(fmu, *state, bytes, size));
}

/* FMI 2.0: a step is never pending. */
enum { LAST_SUCCESSFUL_TIME = 2 };

EXPORT status fmi2GetRealStatus(struct fmu *fmu, int kind, double *value)
{
    if (kind != LAST_SUCCESSFUL_TIME)
        return DISCARD;
    *value = fmu->now.time;
    return OK;
}

/* What the unit does not have. Of values that it has none of, none may be asked for. */
#define ABSENT(name, how) EXPORT status name(void) { return how; }
#define NONE(name) \
    EXPORT status name(void *fmu, const uint32_t *references, size_t count) \
    { \
        (void)fmu, (void)references; \
        return count == 0 ? OK : ERROR; \
    }
NONE(fmi2GetBoolean) NONE(fmi2SetBoolean) NONE(fmi2GetString) NONE(fmi2SetString)
ABSENT(fmi2GetDirectionalDerivative, ERROR)
ABSENT(fmi2SetRealInputDerivatives, ERROR) ABSENT(fmi2GetRealOutputDerivatives, ERROR)
ABSENT(fmi2CancelStep, ERROR) ABSENT(fmi2GetStatus, DISCARD)
ABSENT(fmi2GetIntegerStatus, DISCARD) ABSENT(fmi2GetBooleanStatus, DISCARD)
ABSENT(fmi2GetStringStatus, DISCARD)
