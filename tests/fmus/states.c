/* An FMU of FMI 2.0 for tests whose saved state lacks a count of its steps: every so many steps the output jumps, so
 * that a restored instance jumps at other ones. The token in the model description chooses what it does besides:
 * `jump N` nothing, `crash NAME`, `hang NAME` and `fail NAME` do that in this function of an instance that was
 * restored, and `address` saves the address of the instance. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fmi2Functions.h"

enum { Y = 1, U, COUNT };

typedef struct {
    double real[COUNT];
} State;

typedef struct Instance {
    State state;
    /* Not saved. */
    int steps, period;
    int is_restored;
    char token[64];
    fmi2CallbackLogger log;
    fmi2ComponentEnvironment environment;
} Instance;

/* What an instance saves whose bytes hold an address. */
typedef struct {
    State state;
    Instance *instance;
} Saved;

static int is_address(const Instance *one) { return strcmp(one->token, "address") == 0; }

static fmi2Status reach(const Instance *one, const char *function) {
    const char *name = strchr(one->token, ' ');
    if (!one->is_restored || !name || strcmp(name + 1, function) != 0) return fmi2OK;
    volatile int *volatile nowhere = NULL;
    switch (one->token[0]) {
    case 'c': *nowhere = 1; break;
    case 'h': for (;;) pause();
    case 'f': one->log(one->environment, "states", fmi2Error, "error", "the mesh is gone"); return fmi2Error;
    }
    return fmi2OK;
}

const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

fmi2Status fmi2SetDebugLogging(fmi2Component one, fmi2Boolean on, size_t count, const fmi2String names[]) {
    (void)one, (void)on, (void)count, (void)names;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)type, (void)resources, (void)visible, (void)logging;
    Instance *one = calloc(1, sizeof *one);
    strncpy(one->token, token, sizeof one->token - 1);
    if (strncmp(token, "jump ", 5) == 0) one->period = atoi(token + 5);
    one->log = callbacks->logger;
    one->environment = callbacks->componentEnvironment;
    return one;
}

void fmi2FreeInstance(fmi2Component one) { free(one); }

fmi2Status fmi2SetupExperiment(fmi2Component one, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    (void)one, (void)tolerance_defined, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component one) { (void)one; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component one) { (void)one; return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component one) { (void)one; return fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference refs[], size_t count, fmi2Real values[]) {
    Instance *one = instance;
    for (size_t i = 0; i < count; i++) values[i] = one->state.real[refs[i]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference refs[], size_t count,
                       const fmi2Real values[]) {
    Instance *one = instance;
    for (size_t i = 0; i < count; i++) one->state.real[refs[i]] = values[i];
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real at, fmi2Real h, fmi2Boolean never_back) {
    (void)at, (void)never_back;
    Instance *one = instance;
    one->steps++;
    one->state.real[Y] += h * (1.0 + one->state.real[U]);
    if (one->period && one->steps % one->period == 0) one->state.real[Y] += 1.0;
    if (one->steps == 3) return reach(one, "fmi2DoStep");
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component one, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)one, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetFMUstate(fmi2Component instance, fmi2FMUstate *state) {
    Instance *one = instance;
    Saved *saved = calloc(1, sizeof *saved);
    saved->state = one->state;
    saved->instance = is_address(one) ? one : NULL;
    *state = saved;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component instance, fmi2FMUstate state) {
    Instance *one = instance;
    const Saved *saved = state;
    one->is_restored = 1;
    /* The address of the process that saved it is not one here, or that of something else. */
    if (saved->instance && saved->instance != one) abort();
    one->state = saved->state;
    return reach(one, "fmi2SetFMUstate");
}

fmi2Status fmi2FreeFMUstate(fmi2Component one, fmi2FMUstate *state) {
    (void)one;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component one, fmi2FMUstate state, size_t *size) {
    (void)one, (void)state;
    *size = sizeof(Saved);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component one, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)one;
    memcpy(bytes, state, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component instance, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    Instance *one = instance;
    one->is_restored = 1;
    *state = malloc(sizeof(Saved));
    memcpy(*state, bytes, size);
    return reach(one, "fmi2DeSerializeFMUstate");
}
