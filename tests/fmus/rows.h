/* An FMU for tests whose variables are numbers in a row, each at the place of its value reference, from 1 on. Whoever
 * includes it has said before what it is: `TOKEN`; `COUNT`, one more than there are variables; `FIRST_SET`, the first
 * one that may be set; and `advance`, a step of so many seconds. Of FMI 2.0 with -DFMI_VERSION=2, else of 3.0. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static void advance(double *values, double h);

/* What becomes of a value that is set; with another definition the FMU is one that has its own will. */
#ifndef KEPT
#define KEPT(value) (value)
#endif

/* Value reference of a variable that cannot be read; 0 for none. */
#ifndef UNREADABLE
#define UNREADABLE 0
#endif

/* What is done with what the start is told, where -1 stands for nothing, and with the time of a step. */
#ifndef BEGUN
#define BEGUN(values, tolerance, start, stop) ((void)(values), (void)(tolerance), (void)(start), (void)(stop))
#define REACHED(values, at) ((void)(values), (void)(at))
#endif

static bool read_row(const double *row, const unsigned refs[], size_t count, double values[]) {
    for (size_t i = 0; i < count; i++) {
        if (refs[i] < 1 || refs[i] >= COUNT || refs[i] == UNREADABLE) return false;
        values[i] = row[refs[i]];
    }
    return true;
}

static bool write_row(double *row, const unsigned refs[], size_t count, const double values[]) {
    for (size_t i = 0; i < count; i++) {
        if (refs[i] < FIRST_SET || refs[i] >= COUNT) return false;
        row[refs[i]] = KEPT(values[i]);
    }
    return true;
}

static double *made(const char *token) { return strcmp(token, TOKEN) == 0 ? calloc(COUNT, sizeof(double)) : NULL; }

#if FMI_VERSION == 2
#include "fmi2Functions.h"

const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

fmi2Status fmi2SetDebugLogging(fmi2Component one, fmi2Boolean on, size_t count, const fmi2String names[]) {
    (void)one, (void)on, (void)count, (void)names;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)resources, (void)callbacks, (void)visible, (void)logging;
    return type == fmi2CoSimulation ? made(token) : NULL;
}

void fmi2FreeInstance(fmi2Component one) { free(one); }

fmi2Status fmi2SetupExperiment(fmi2Component one, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    BEGUN((double *)one, tolerance_defined ? tolerance : -1.0, start, stop_defined ? stop : -1.0);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component one) { (void)one; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component one) { (void)one; return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component one) { (void)one; return fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component one, const fmi2ValueReference refs[], size_t count, fmi2Real values[]) {
    return read_row(one, refs, count, values) ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetReal(fmi2Component one, const fmi2ValueReference refs[], size_t count, const fmi2Real values[]) {
    return write_row(one, refs, count, values) ? fmi2OK : fmi2Error;
}

fmi2Status fmi2DoStep(fmi2Component one, fmi2Real at, fmi2Real h, fmi2Boolean never_back) {
    (void)never_back;
    REACHED((double *)one, at);
    advance(one, h);
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component one, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)one, (void)kind, (void)value;
    return fmi2Discard;
}
#else
#include "idle.h"

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)needed, (void)count;
    (void)environment, (void)log, (void)update;
    return made(token);
}

void fmi3FreeInstance(fmi3Instance one) { free(one); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance one, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    BEGUN((double *)one, tolerance_defined ? tolerance : -1.0, start, stop_defined ? stop : -1.0);
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance one) { (void)one; return fmi3OK; }

/* With -DARRAYS a call for fewer references than values is one for an array that begins there. */
static bool is_array(size_t count, size_t n) {
#ifdef ARRAYS
    return count == 1 && n > 1;
#else
    (void)count, (void)n;
    return false;
#endif
}

fmi3Status fmi3GetFloat64(fmi3Instance one, const fmi3ValueReference refs[], size_t count, fmi3Float64 values[],
                          size_t n) {
    if (is_array(count, n)) {
        memcpy(values, (double *)one + refs[0], n * sizeof *values);
        return fmi3OK;
    }
    return n == count && read_row(one, refs, count, values) ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SetFloat64(fmi3Instance one, const fmi3ValueReference refs[], size_t count, const fmi3Float64 values[],
                          size_t n) {
    if (is_array(count, n)) {
        memcpy((double *)one + refs[0], values, n * sizeof *values);
        return fmi3OK;
    }
    return n == count && write_row(one, refs, count, values) ? fmi3OK : fmi3Error;
}

fmi3Status fmi3DoStep(fmi3Instance one, fmi3Float64 at, fmi3Float64 h, fmi3Boolean never_back, fmi3Boolean *event,
                      fmi3Boolean *over, fmi3Boolean *early, fmi3Float64 *reached) {
    (void)never_back;
    REACHED((double *)one, at);
    advance(one, h);
    *event = *over = *early = false;
    *reached = at + h;
    return fmi3OK;
}
#endif
