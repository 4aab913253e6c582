/* Two equal channels with a zero in the right half plane, each fed by both commands, and their law, with -DLAW.
 *
 * Channel i: v_i = u_i + c u_k, tau a' = v - a, tau b' = a - b, y = b - T b'; so y = (1 - T s) / (1 + tau s)^2 v.
 * Law: u_i = -k_i y_i. */
#include <hil.h>
#include <string.h>

static const hil_signal measured[] = {
    {"first_m", "m", "Output of channel 1.", 0.0, 0.0},
    {"second_m", "m", "Output of channel 2.", 0.0, 0.0},
};
static const hil_signal commands[] = {
    {"first_n", "N", "Command of channel 1.", 0.0, 0.0},
    {"second_n", "N", "Command of channel 2.", 0.0, 0.0},
};

#ifdef LAW
static const hil_parameter parameters[] = {
    {"first_n_per_m", "N/m", "Gain of channel 1.", 1.0, 0.0, 1e3, 0},
    {"second_n_per_m", "N/m", "Gain of channel 2.", 1.0, 0.0, 1e3, 0},
    {"limit_n", "N", "Largest command.", 1e9, 0.0, 1e9, 0},
};
struct law {
    double gain[2], limit_n;
};
static int start(void *self, const hil_setup *setup) {
    return memcpy(self, setup->parameters, sizeof(struct law)), HIL_OK;
}
static int step(void *self, const hil_sample *sample, double *command, double *internals) {
    const struct law *law = self;
    (void)internals;
    for (int i = 0; i < 2; i++) {
        const double u = -law->gain[i] * sample->measured[i];
        command[i] = u > law->limit_n ? law->limit_n : u < -law->limit_n ? -law->limit_n : u;
#ifdef FAILS_ABOVE
        if (u * u > FAILS_ABOVE) command[i] = 0.0 / (u - u);
#endif
    }
    return HIL_OK;
}
int main(int argc, char **argv) {
    const hil_controller controller = {
        .api = HIL_API, .name = "crossed-law", .version = "0.1.0", .summary = "Two gains.",
        .parameters = HIL_TABLE(parameters), .measured = HIL_TABLE(measured),
        .commands = HIL_TABLE(commands), .size = sizeof(struct law), .start = start, .step = step};
    return hil_controller_main(argc, argv, &controller);
}
#else
static const hil_parameter parameters[] = {
    {"coupling", "1", "Share c of the other command.", 0.0, -10.0, 10.0, 0},
    {"zero_s", "s", "Time T of the zero.", 0.05, 0.0, 1.0, 0},
    {"lag_s", "s", "Time tau of both lags.", 0.1, 1e-3, 10.0, 0},
};
struct plant {
    struct { double coupling, zero_s, lag_s; } p;
    double state[4], command[2];
};
static int retune(void *self, const double *row) {
    return memcpy(&((struct plant *)self)->p, row, sizeof(double[3])), HIL_OK;
}
static int measure(const void *self, double *row) {
    const struct plant *plant = self;
    for (int i = 0; i < 2; i++) {
        const double a = plant->state[2 * i], b = plant->state[2 * i + 1];
        row[i] = b - plant->p.zero_s * (a - b) / plant->p.lag_s;
    }
    return HIL_OK;
}
static int tell_truth(const void *self, double time_s, const double *row, double *truth) {
    return (void)time_s, (void)row, measure(self, truth);
}
static void rates(const void *self, double time_s, const double *x, double *dx) {
    const struct plant *plant = self;
    (void)time_s;
    for (int i = 0; i < 2; i++) {
        const double v = plant->command[i] + plant->p.coupling * plant->command[1 - i];
        dx[2 * i] = (v - x[2 * i]) / plant->p.lag_s;
        dx[2 * i + 1] = (x[2 * i] - x[2 * i + 1]) / plant->p.lag_s;
    }
}
static int advance(void *self, const hil_interval *interval, const double *row) {
    struct plant *plant = self;
    memcpy(plant->command, row, sizeof plant->command);
    return hil_integrate(plant->state, 4, interval, rates, plant);
}
int main(int argc, char **argv) {
    const hil_plant plant = {
        .api = HIL_API, .name = "crossed", .version = "0.1.0",
        .summary = "Two channels with a zero in the right half plane, each fed by both commands.",
        .parameters = HIL_TABLE(parameters), .commands = HIL_TABLE(commands),
        .truth = HIL_TABLE(measured), .measured = HIL_TABLE(measured), .size = sizeof(struct plant),
        .start = retune, .retune = retune, .measure = measure, .tell_truth = tell_truth,
        .advance = advance};
    return hil_plant_main(argc, argv, &plant);
}
#endif
