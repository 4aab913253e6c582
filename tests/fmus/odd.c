/* An FMU of FMI 2.0 for tests that does what vendors' FMUs do and the standard does not foresee. `-DVALUE=..` is the
 * output after `n` steps, and the token in the model description chooses the rest: `crash NAME` crashes in that
 * function, `slow MS` takes so long to be instantiated, `say TEXT` says a text by "%s" and fails at the third step,
 * `lost TEXT` does so with an environment that is none, `unstepped` crashes if it is freed before its first step,
 * `exit NAME` says a text on standard output and calls exit(7) in that function, `late MS` takes so long to be freed.
 * With -DEXITS_AT_VERSION it exits when it is asked for its version, with -DEXIT_CODE=N by another code, and with
 * -DAT_LOAD=.. it does that when it is loaded. With -DMARKER="FILE" only the first instance is slow, which makes FILE. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2Functions.h"

/* Defined nowhere. */
double no_such_function(double at);

enum { Y = 1, U, P, COUNT };

typedef struct {
    double real[COUNT];
    int whole[COUNT];
    int n;
    char token[64];
    fmi2CallbackLogger log;
    fmi2ComponentEnvironment environment;
} Instance;

#ifndef EXIT_CODE
#define EXIT_CODE 7
#endif

static void give_up(void) {
    puts("no license for the hydraulics library");
    exit(EXIT_CODE);
}

#ifdef AT_LOAD
__attribute__((constructor)) static void load(void) { AT_LOAD; }
#endif

static int is_slow(void) {
#ifdef MARKER
    FILE *marker = fopen(MARKER, "wx");
    return marker != NULL && fclose(marker) == 0;
#else
    return 1;
#endif
}

static void reach(const Instance *one, const char *function) {
    if (strncmp(one->token, "crash ", 6) == 0 && strcmp(one->token + 6, function) == 0) {
        volatile int *volatile nowhere = NULL;
        *nowhere = 1;
    }
    if (strncmp(one->token, "exit ", 5) == 0 && strcmp(one->token + 5, function) == 0) {
        give_up();
    }
}

static void wait_ms(const char *text) {
    const long ms = atol(text);
    const struct timespec time = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&time, NULL);
}

const char *fmi2GetVersion(void) {
#ifdef EXITS_AT_VERSION
    give_up();
#endif
    return "2.0";
}
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
    one->log = callbacks->logger;
    one->environment = callbacks->componentEnvironment;
    reach(one, "fmi2Instantiate");
    if (strncmp(token, "slow ", 5) == 0 && is_slow()) wait_ms(token + 5);
    return one;
}

void fmi2FreeInstance(fmi2Component instance) {
    Instance *one = instance;
    reach(one, "fmi2FreeInstance");
    if (strcmp(one->token, "unstepped") == 0 && one->n == 0) abort();
    if (strncmp(one->token, "late ", 5) == 0) wait_ms(one->token + 5);
    free(one);
}

fmi2Status fmi2SetupExperiment(fmi2Component one, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    (void)tolerance_defined, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    reach(one, "fmi2SetupExperiment");
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component one) {
    reach(one, "fmi2EnterInitializationMode");
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component one) {
    reach(one, "fmi2ExitInitializationMode");
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component one) {
    reach(one, "fmi2Terminate");
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference refs[], size_t count, fmi2Real values[]) {
    Instance *one = instance;
    reach(one, "fmi2GetReal");
    for (size_t i = 0; i < count; i++) values[i] = one->real[refs[i]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference refs[], size_t count,
                       const fmi2Real values[]) {
    Instance *one = instance;
    for (size_t i = 0; i < count; i++) one->real[refs[i]] = values[i];
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component instance, const fmi2ValueReference refs[], size_t count,
                          fmi2Integer values[]) {
    Instance *one = instance;
    for (size_t i = 0; i < count; i++) values[i] = one->whole[refs[i]];
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component instance, const fmi2ValueReference refs[], size_t count,
                          const fmi2Integer values[]) {
    Instance *one = instance;
    for (size_t i = 0; i < count; i++) one->whole[refs[i]] = values[i];
    return fmi2OK;
}

/* True is -1 at every second step, as of tools whose booleans are Basic's. */
fmi2Status fmi2GetBoolean(fmi2Component instance, const fmi2ValueReference refs[], size_t count,
                          fmi2Boolean values[]) {
    Instance *one = instance;
    (void)refs;
    for (size_t i = 0; i < count; i++) values[i] = one->n % 2 ? -1 : 0;
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component one, const fmi2ValueReference refs[], size_t count,
                          const fmi2Boolean values[]) {
    (void)one, (void)refs, (void)count, (void)values;
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real at, fmi2Real h, fmi2Boolean never_back) {
    (void)at, (void)h, (void)never_back;
    Instance *one = instance;
    one->n++;
    const double n = one->n;
    one->real[Y] = VALUE;
    one->whole[Y] = one->whole[U];
    if (one->n == 3) {
        reach(one, "fmi2DoStep");
        if (strncmp(one->token, "say ", 4) == 0) {
            one->log(one->environment, "odd", fmi2Error, "error", "%s", one->token + 4);
            return fmi2Error;
        }
        if (strncmp(one->token, "lost ", 5) == 0) {
            one->log((void *)1, "odd", fmi2Error, "error", "%s", one->token + 5);
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component one, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)one, (void)kind, (void)value;
    return fmi2Discard;
}
