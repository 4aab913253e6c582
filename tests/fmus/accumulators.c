/* An FMU for tests whose outputs count: each grows at a step by its input and its gain. `COUNT_OF` is the number of
 * outputs, of inputs and of gains, which stand one after the other. */

#define TOKEN "accumulators"
enum { FIRST_SET = 1 + COUNT_OF, COUNT = 1 + 3 * COUNT_OF };

#include "rows.h"

static void advance(double *values, double h) {
    (void)h;
    double *output = &values[1];
    const double *input = output + COUNT_OF, *gain = input + COUNT_OF;
    for (int i = 0; i < COUNT_OF; i++) output[i] += input[i] + gain[i];
}
