/* An FMU for tests: a mass on a spring in millimetres and kilonewtons, `m s'' = f - c s' - k s`, as a tool that knows no
 * SI would export it. The equation and its integration stand in the order of those of the twin in Rust
 * (`tests/examples/foreign-plant.rs`), so every bit is the same. */

enum { S = 1, SPEED, FORCE, MASS, DAMPING, STIFFNESS, COUNT, FIRST_SET = FORCE };
#define TOKEN "slider"

#include "rows.h"

static void rates(const double *p, const double x[2], double dx[2]) {
    const double per_m = 1e3, per_n = 1e-3;
    dx[0] = x[1];
    dx[1] = (p[FORCE] / per_n - p[DAMPING] * (x[1] / per_m) - p[STIFFNESS] * (x[0] / per_m)) / p[MASS] * per_m;
}

/* The classic method of Runge and Kutta. */
static void advance(double *p, double h) {
    double *x = &p[S];
    double k1[2], k2[2], k3[2], k4[2], y[2];
    rates(p, x, k1);
    for (int i = 0; i < 2; i++) y[i] = x[i] + k1[i] * (0.5 * h);
    rates(p, y, k2);
    for (int i = 0; i < 2; i++) y[i] = x[i] + k2[i] * (0.5 * h);
    rates(p, y, k3);
    for (int i = 0; i < 2; i++) y[i] = x[i] + k3[i] * h;
    rates(p, y, k4);
    for (int i = 0; i < 2; i++) x[i] = x[i] + (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (h / 6.0);
}
