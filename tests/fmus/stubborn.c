/* An FMU for tests with two tunable parameters, `p` and `q`, that its outputs show. With -DBEGINS=V its initialisation
 * gives `p` the value V, with -DKEPT(value)=.. a value that is set becomes another one, and with -DUNREADABLE=R the
 * variable R cannot be read. */

#define TOKEN "stubborn"
enum { OUT_P = 1, OUT_Q, P, Q, COUNT, FIRST_SET = P };

#ifdef BEGINS
#define BEGUN(values, tolerance, start, stop) ((values)[P] = (BEGINS), (void)(tolerance), (void)(start), (void)(stop))
#define REACHED(values, at) ((void)(values), (void)(at))
#endif

#include "rows.h"

static void advance(double *values, double h) {
    (void)h;
    values[OUT_P] = values[P];
    values[OUT_Q] = values[Q];
}
