/* An FMU 2.0 for tests: a PI controller `u = 40 e + i`, `i' = 50 e`, `e = r - x`, that provides directional derivatives
 * and saves its state. */
enum { U = 1, I, RATE, X, R, COUNT, FIRST_SET = X };
#define TOKEN "differentiable"

#include "rows.h"

static void evaluate(double *v) {
    v[RATE] = 50.0 * (v[R] - v[X]);
    v[U] = 40.0 * (v[R] - v[X]) + v[I];
}

/* Exact, because the input is held. */
static void advance(double *v, double h) {
    evaluate(v);
    v[I] += h * v[RATE];
    evaluate(v);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component one, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real seed[],
                                        fmi2Real values[]) {
    static const double by[COUNT][COUNT] = {
        [U] = {[I] = 1.0, [X] = -40.0, [R] = 40.0},
        [RATE] = {[X] = -50.0, [R] = 50.0},
    };
    (void)one;
    for (size_t i = 0; i < unknowns; i++) {
        values[i] = 0.0;
        for (size_t k = 0; k < knowns; k++) values[i] += by[unknown[i]][known[k]] * seed[k];
    }
    return fmi2OK;
}

#define SIZE (COUNT * sizeof(double))

fmi2Status fmi2GetFMUstate(fmi2Component one, fmi2FMUstate *state) {
    if (*state == NULL) *state = malloc(SIZE);
    memcpy(*state, one, SIZE);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component one, fmi2FMUstate state) {
    memcpy(one, state, SIZE);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component one, fmi2FMUstate *state) {
    (void)one;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component one, fmi2FMUstate state, size_t *size) {
    (void)one, (void)state;
    *size = SIZE;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component one, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)one;
    memcpy(bytes, state, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component one, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    fmi2GetFMUstate(one, state);
    memcpy(*state, bytes, size);
    return fmi2OK;
}
