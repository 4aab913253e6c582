/* An FMU for tests with as many variables as `tests/shared/vendor_fmu.rs` says: lags of first order,
 * `x_i' = k_i (u_i - x_i)`, by Euler's method. Inner signals are each state and its derivative at the begin of the step,
 * outputs the first states; inputs and rates are used again from the first one on. */

#define TOKEN "vendor"
enum { FIRST_SET = 1 + OUTPUTS + INNER, COUNT = FIRST_SET + INPUTS + PARAMETERS };

#include "rows.h"

static void advance(double *values, double h) {
    double *output = &values[1], *inner = output + OUTPUTS;
    const double *input = inner + INNER, *rate = input + INPUTS;
    for (int i = 0; i < INNER / 2; i++) {
        double *x = &inner[2 * i], *derivative = x + 1;
        *derivative = rate[i % PARAMETERS] * (input[i % INPUTS] - *x);
        *x += *derivative * h;
    }
    for (int i = 0; i < OUTPUTS; i++) output[i] = inner[2 * i];
}
