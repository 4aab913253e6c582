/* An FMU for tests that provides directional derivatives: a swing `a'' = 2 T - 3 sin a - 0.8 a'` with the output
 * `s = sin a + 0.5 T`, so one output depends on the input without delay. It begins at a = 0.6, a' = -0.4. */
#include <math.h>

enum { ANGLE = 1, RATE, ANGLE_RATE, RATE_RATE, SINE, TORQUE, COUNT, FIRST_SET = TORQUE };
#define TOKEN "swing"
#define BEGUN(values, tolerance, start, stop) begin(values)
#define REACHED(values, at) ((void)(values), (void)(at))

static void begin(double *v);

#include "rows.h"

static void evaluate(double *v) {
    v[ANGLE_RATE] = v[RATE];
    v[RATE_RATE] = 2.0 * v[TORQUE] - 3.0 * sin(v[ANGLE]) - 0.8 * v[RATE];
    v[SINE] = sin(v[ANGLE]) + 0.5 * v[TORQUE];
}

static void begin(double *v) {
    v[ANGLE] = 0.6;
    v[RATE] = -0.4;
    evaluate(v);
}

/* Euler's method in a thousand parts: what the FMU does in a step is its own affair. */
static void advance(double *v, double h) {
    for (int i = 0; i < 1000; i++) {
        evaluate(v);
        v[ANGLE] += v[ANGLE_RATE] * h / 1000.0;
        v[RATE] += v[RATE_RATE] * h / 1000.0;
    }
    evaluate(v);
}

static double by(const double *v, unsigned unknown, unsigned known) {
    switch (unknown * 16 + known) {
    case ANGLE_RATE * 16 + RATE: return 1.0;
    case RATE_RATE * 16 + ANGLE: return -3.0 * cos(v[ANGLE]);
    case RATE_RATE * 16 + RATE: return -0.8;
    case RATE_RATE * 16 + TORQUE: return 2.0;
    case SINE * 16 + ANGLE: return cos(v[ANGLE]);
    case SINE * 16 + TORQUE: return 0.5;
    default: return 0.0;
    }
}

#ifndef WITHOUT_DERIVATIVES
#if FMI_VERSION == 2
fmi2Status fmi2GetDirectionalDerivative(fmi2Component one, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                        fmi2Real values[]) {
#else
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance one, const fmi3ValueReference unknown[], size_t unknowns,
                                        const fmi3ValueReference known[], size_t knowns, const fmi3Float64 seed[],
                                        size_t seeds, fmi3Float64 values[], size_t results) {
    if (seeds != knowns || results != unknowns) return fmi3Error;
#endif
    for (size_t i = 0; i < unknowns; i++) {
        values[i] = 0.0;
        for (size_t k = 0; k < knowns; k++) values[i] += by(one, unknown[i], known[k]) * seed[k];
    }
    return 0;
}
#endif
