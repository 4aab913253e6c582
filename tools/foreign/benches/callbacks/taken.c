/* Takes the plant of a program in C instead of running it, for the bench `callbacks`. */
#include <hil.h>

hil_plant taken;
double (*bench_sin)(double x);
int (*bench_integrate)(double *state, size_t count, const hil_interval *interval, hil_rates rates, const void *context);

double hil_sin(double x) { return bench_sin(x); }
int hil_integrate(double *state, size_t count, const hil_interval *interval, hil_rates rates, const void *context) {
    return bench_integrate(state, count, interval, rates, context);
}
int hil_plant_main(int argc, char **argv, const hil_plant *plant) {
    (void)argc, (void)argv;
    taken = *plant;
    return 0;
}
