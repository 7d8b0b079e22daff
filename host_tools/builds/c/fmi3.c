/* The interface of FMI 3.0 (https://fmi-standard.org), co-simulation. */
#include <stdlib.h>
#include <string.h>

#include "fmu.h"

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } status;
typedef void (*log_message)(void *environment, status how, const char *category, const char *text);

static status answer(struct fmu *fmu, bool is_well)
{
    if (!is_well && fmu->log != NULL)
        ((log_message)fmu->log)(fmu->environment, ERROR, "logStatusError", fmu->reason);
    return is_well ? OK : ERROR;
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT void *fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early, const uint32_t *intermediate, size_t count, void *environment,
    log_message log, void *update)
{
    struct fmu *fmu = fmu_new(token);
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early;
    (void)intermediate, (void)count, (void)update;
    if (fmu == NULL) {
        if (log != NULL)
            log(environment, ERROR, "logStatusError", "not the instantiation token of this unit");
        return NULL;
    }
    fmu->environment = environment;
    fmu->log = (void *)log;
    return fmu;
}

EXPORT void fmi3FreeInstance(void *instance)
{
    free(instance);
}

EXPORT status fmi3SetDebugLogging(void *fmu, bool on, size_t count, const char *const *categories)
{
    (void)fmu, (void)on, (void)count, (void)categories;
    return OK;
}

EXPORT status fmi3EnterInitializationMode(struct fmu *fmu, bool has_tolerance, double tolerance,
                                          double start, bool has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    fmu->now.time = start;
    return OK;
}

EXPORT status fmi3ExitInitializationMode(struct fmu *fmu)
{
    return answer(fmu, fmu_begin(fmu));
}

EXPORT status fmi3Terminate(void *fmu)
{
    (void)fmu;
    return OK;
}

EXPORT status fmi3Reset(struct fmu *fmu)
{
    fmu_reset(fmu);
    return OK;
}

EXPORT status fmi3DoStep(struct fmu *fmu, double time, double length, bool keeps, bool *event,
                         bool *terminate, bool *early, double *last)
{
    bool is_well = fmu_step(fmu, time, length);
    (void)keeps;
    *event = *terminate = *early = false;
    *last = fmu->now.time;
    return answer(fmu, is_well);
}

EXPORT status fmi3GetFloat64(struct fmu *fmu, const uint32_t *references, size_t count,
                             double *values, size_t room)
{
    bool is_well = room >= count;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = fmu_get(fmu, references[k], &values[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi3SetFloat64(struct fmu *fmu, const uint32_t *references, size_t count,
                             const double *values, size_t given)
{
    bool is_well = given >= count;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = fmu_set(fmu, references[k], values[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi3GetInt64(struct fmu *fmu, const uint32_t *references, size_t count,
                           int64_t *values, size_t room)
{
    bool is_well = room >= count;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = fmu_get_integer(fmu, references[k], &values[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi3SetInt64(struct fmu *fmu, const uint32_t *references, size_t count,
                           const int64_t *values, size_t given)
{
    bool is_well = given >= count;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = fmu_set(fmu, references[k], (double)values[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi3GetBinary(struct fmu *fmu, const uint32_t *references, size_t count,
                            size_t *sizes, const uint8_t **values, size_t room)
{
    (void)room;
    for (size_t k = 0; k < count; k++) {
        bool is_sent = references[k] == FMU_SENT;
        if (!is_sent && references[k] != FMU_RECEIVED)
            return ERROR;
        sizes[k] = is_sent ? fmu->now.sent_size : fmu->now.received_size;
        values[k] = is_sent ? fmu_sent(fmu) : fmu->now.received;
    }
    return OK;
}

EXPORT status fmi3SetBinary(struct fmu *fmu, const uint32_t *references, size_t count,
                            const size_t *sizes, const uint8_t *const *values, size_t given)
{
    bool is_well = given >= count;
    for (size_t k = 0; is_well && k < count; k++)
        is_well = references[k] == FMU_RECEIVED && fmu_set_received(fmu, values[k], sizes[k]);
    return answer(fmu, is_well);
}

EXPORT status fmi3GetFMUState(struct fmu *fmu, void **state)
{
    return answer(fmu, fmu_save(fmu, state));
}

EXPORT status fmi3SetFMUState(struct fmu *fmu, const void *state)
{
    return answer(fmu, fmu_load(fmu, state));
}

EXPORT status fmi3FreeFMUState(void *fmu, void **state)
{
    (void)fmu;
    free(*state);
    *state = NULL;
    return OK;
}

EXPORT status fmi3SerializedFMUStateSize(void *fmu, const void *state, size_t *size)
{
    (void)fmu, (void)state;
    *size = sizeof(struct fmu_state);
    return OK;
}

EXPORT status fmi3SerializeFMUState(struct fmu *fmu, const void *state, uint8_t *bytes, size_t size)
{
    return answer(fmu, fmu_copy_state(fmu, bytes, state, size));
}

EXPORT status fmi3DeserializeFMUState(struct fmu *fmu, const uint8_t *bytes, size_t size,
                                      void **state)
{
    return answer(fmu, fmu_save(fmu, state) && fmu_copy_state(fmu, *state, bytes, size));
}

/* What the unit does not have. Of values that it has none of, none may be asked for. */
#define ABSENT(name) EXPORT status name(void) { return ERROR; }
#define NONE(name) \
    EXPORT status name(void *fmu, const uint32_t *references, size_t count) \
    { \
        (void)fmu, (void)references; \
        return count == 0 ? OK : ERROR; \
    }
#define NO_VALUES(type) NONE(fmi3Get##type) NONE(fmi3Set##type)
NO_VALUES(Float32) NO_VALUES(Int8) NO_VALUES(UInt8) NO_VALUES(Int16) NO_VALUES(UInt16)
NO_VALUES(Int32) NO_VALUES(UInt32) NO_VALUES(UInt64) NO_VALUES(Boolean) NO_VALUES(String)
NO_VALUES(Clock) NO_VALUES(IntervalDecimal) NO_VALUES(IntervalFraction) NO_VALUES(ShiftDecimal)
NO_VALUES(ShiftFraction)
ABSENT(fmi3GetContinuousStates) ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3GetNumberOfVariableDependencies) ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3GetDirectionalDerivative) ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3EnterConfigurationMode) ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3EnterEventMode) ABSENT(fmi3EnterStepMode) ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3EvaluateDiscreteStates) ABSENT(fmi3UpdateDiscreteStates)
ABSENT(fmi3CompletedIntegratorStep) ABSENT(fmi3SetTime) ABSENT(fmi3GetContinuousStateDerivatives)
ABSENT(fmi3GetEventIndicators) ABSENT(fmi3GetNominalsOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators) ABSENT(fmi3GetNumberOfContinuousStates)
ABSENT(fmi3GetOutputDerivatives) ABSENT(fmi3ActivateModelPartition)

EXPORT void *fmi3InstantiateModelExchange(void)
{
    return NULL;
}

EXPORT void *fmi3InstantiateScheduledExecution(void)
{
    return NULL;
}
