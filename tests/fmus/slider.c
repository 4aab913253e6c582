/* An FMU of FMI 3.0 for tests: a mass on a spring in millimetres and kilonewtons, `m s'' = f - c s' - k s`, as a tool
 * that knows no SI would export it. The equation and its integration stand in the order of those of the twin in Rust
 * (`tests/examples/foreign-plant.rs`), so every bit is the same. */

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

enum { S = 1, SPEED, FORCE, MASS, DAMPING, STIFFNESS, COUNT };

typedef struct {
    double values[COUNT];
} Instance;

const char *fmi3GetVersion(void) { return "3.0"; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String names[]) {
    (void)instance, (void)on, (void)count, (void)names;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)needed, (void)count;
    (void)environment, (void)log, (void)update;
    return strcmp(token, "slider") == 0 ? calloc(1, sizeof(Instance)) : NULL;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    (void)instance, (void)tolerance_defined, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { (void)instance; return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance instance) { (void)instance; return fmi3OK; }

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count, fmi3Float64 values[],
                          size_t n) {
    for (size_t i = 0; i < count; i++) {
        if (n != count || refs[i] < S || refs[i] >= COUNT) return fmi3Error;
        values[i] = ((Instance *)instance)->values[refs[i]];
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count,
                          const fmi3Float64 values[], size_t n) {
    for (size_t i = 0; i < count; i++) {
        if (n != count || refs[i] < FORCE || refs[i] >= COUNT) return fmi3Error;
        ((Instance *)instance)->values[refs[i]] = values[i];
    }
    return fmi3OK;
}

static void rates(const double *p, const double x[2], double dx[2]) {
    const double per_m = 1e3, per_n = 1e-3;
    dx[0] = x[1];
    dx[1] = (p[FORCE] / per_n - p[DAMPING] * (x[1] / per_m) - p[STIFFNESS] * (x[0] / per_m)) / p[MASS] * per_m;
}

/* The classic method of Runge and Kutta. */
fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 at, fmi3Float64 h, fmi3Boolean never_back, fmi3Boolean *event,
                      fmi3Boolean *over, fmi3Boolean *early, fmi3Float64 *reached) {
    (void)never_back;
    double *p = ((Instance *)instance)->values, *x = &p[S];
    double k1[2], k2[2], k3[2], k4[2], y[2];
    rates(p, x, k1);
    for (int i = 0; i < 2; i++) y[i] = x[i] + k1[i] * (0.5 * h);
    rates(p, y, k2);
    for (int i = 0; i < 2; i++) y[i] = x[i] + k2[i] * (0.5 * h);
    rates(p, y, k3);
    for (int i = 0; i < 2; i++) y[i] = x[i] + k3[i] * h;
    rates(p, y, k4);
    for (int i = 0; i < 2; i++) x[i] = x[i] + (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (h / 6.0);
    *event = *over = *early = false;
    *reached = at + h;
    return fmi3OK;
}
