/* A mass on a spring in millimetres and kilonewtons as a plant in C, `m s'' = f - c s' - k s`: the twin of that in
 * `tests/examples/foreign-plant.rs`. Tests of `[[connect]]` run a law of other names and units on it. */
#include <hil.h>
#include <string.h>

static const hil_parameter parameters[] = {
    {"mass_kg", "kg", "Mass m.", 1.0, 1e-6, 1e9, 0},
    {"damping_n_s_per_m", "N s/m", "Damping c.", 2.0, 0.0, 1e9, 0},
    {"stiffness_n_per_m", "N/m", "Stiffness k.", 100.0, 0.0, 1e12, 0},
};
static const hil_signal way[] = {
    {"s", "mm", "Way s.", 0.0, 0.0},
    {"der__s", "mm/s", "Its derivative.", 0.0, 0.0},
};
static const hil_signal command[] = {{"f", "kN", "Force f.", 0.0, 0.0}};

struct slider {
    double mass_kg, damping_n_s_per_m, stiffness_n_per_m, force_kn, state[2];
};

static int retune(void *self, const double *row) { return memcpy(self, row, sizeof(double[3])), HIL_OK; }
static int measure(const void *self, double *row) {
    return memcpy(row, ((const struct slider *)self)->state, sizeof(double[2])), HIL_OK;
}
static int tell_truth(const void *self, double time_s, const double *row, double *truth) {
    return (void)time_s, (void)row, measure(self, truth);
}
static void rates(const void *self, double time_s, const double *x, double *dx) {
    const struct slider *p = self;
    const double per_m = 1e3, per_n = 1e-3;
    (void)time_s, dx[0] = x[1];
    dx[1] = (p->force_kn / per_n - p->damping_n_s_per_m * (x[1] / per_m) - p->stiffness_n_per_m * (x[0] / per_m)) /
            p->mass_kg * per_m;
}
static int advance(void *self, const hil_interval *interval, const double *row) {
    struct slider *slider = self;
    slider->force_kn = row[0];
    return hil_integrate(slider->state, 2, interval, rates, slider);
}
int main(int argc, char **argv) {
    const hil_plant plant = {
        .api = HIL_API, .name = "slider", .summary = "A mass on a spring under foreign names.",
        .parameters = HIL_TABLE(parameters), .commands = HIL_TABLE(command), .truth = HIL_TABLE(way),
        .measured = HIL_TABLE(way), .size = sizeof(struct slider), .start = retune, .retune = retune,
        .measure = measure, .tell_truth = tell_truth, .advance = advance};
    return hil_plant_main(argc, argv, &plant);
}
