/* An FMU of FMI 3.0 for tests whose arrays have as many elements as its structural parameter `n` says: outputs `y` grow
 * at a step by `k` and the inputs `u`. `n` is set in configuration mode alone. */
#include "idle.h"

enum { N = 1, K, U, Y, MOST = 8 };

typedef struct {
    bool is_configured;
    size_t n;
    double k[MOST], u[MOST], y[MOST];
} Instance;

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)needed;
    (void)count, (void)environment, (void)log, (void)update;
    Instance *one = calloc(1, sizeof *one);
    if (one != NULL) one->n = 3;
    return one;
}

void fmi3FreeInstance(fmi3Instance one) { free(one); }

fmi3Status fmi3EnterConfigurationMode(fmi3Instance one) {
    ((Instance *)one)->is_configured = true;
    return fmi3OK;
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance one) {
    ((Instance *)one)->is_configured = false;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance one, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    (void)one, (void)tolerance_defined, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance one) { (void)one; return fmi3OK; }

fmi3Status fmi3GetUInt64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count, fmi3UInt64 values[],
                         size_t n) {
    if (count != 1 || n != 1 || refs[0] != N) return fmi3Error;
    values[0] = ((Instance *)instance)->n;
    return fmi3OK;
}

fmi3Status fmi3SetUInt64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count,
                         const fmi3UInt64 values[], size_t n) {
    Instance *one = instance;
    if (!one->is_configured || count != 1 || n != 1 || refs[0] != N || values[0] > MOST) return fmi3Error;
    one->n = values[0];
    return fmi3OK;
}

static double *row(Instance *one, unsigned ref) { return ref == K ? one->k : ref == U ? one->u : one->y; }

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count, fmi3Float64 values[],
                          size_t n) {
    Instance *one = instance;
    if (n != count * one->n) return fmi3Error;
    for (size_t i = 0; i < count; i++) memcpy(values + i * one->n, row(one, refs[i]), one->n * sizeof *values);
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count,
                          const fmi3Float64 values[], size_t n) {
    Instance *one = instance;
    if (n != count * one->n) return fmi3Error;
    for (size_t i = 0; i < count; i++) memcpy(row(one, refs[i]), values + i * one->n, one->n * sizeof *values);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 at, fmi3Float64 h, fmi3Boolean never_back, fmi3Boolean *event,
                      fmi3Boolean *over, fmi3Boolean *early, fmi3Float64 *reached) {
    (void)never_back;
    Instance *one = instance;
    for (size_t i = 0; i < one->n; i++) one->y[i] += one->k[i] + one->u[i];
    *event = *over = *early = false;
    *reached = at + h;
    return fmi3OK;
}
