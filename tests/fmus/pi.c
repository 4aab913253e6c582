/* An FMU for tests: a PI controller, `u = kp e + i`, whose integral grows by `ki h e` at a step. With -DSAMPLED it gives
 * what follows from the sample and then integrates, as a clocked block does; else its solver integrates up to the end
 * of the step, and the output is the one of that time. */

#define TOKEN "pi"
enum { U = 1, I, E, KP, KI, COUNT, FIRST_SET = E };

#include "rows.h"

static void advance(double *p, double h) {
#ifdef SAMPLED
    p[U] = p[KP] * p[E] + p[I];
    p[I] += p[KI] * h * p[E];
#else
    p[I] += p[KI] * h * p[E];
    p[U] = p[KP] * p[E] + p[I];
#endif
}
