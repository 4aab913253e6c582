/* A pendulum on its head, with a motor at its pivot: m l^2 a'' = m g l sin a - c a' + T. */
#include <hil.h>
#include <string.h>

static const hil_parameter parameters[] = {
    {"mass_kg", "kg", "Mass m at the end of the rod.", 1.0, 1e-3, 1e3, HIL_FAULTABLE},
    {"length_m", "m", "Length l of the rod.", 0.5, 1e-2, 1e2, 0},
    {"friction_nm_s_per_rad", "N m s/rad", "Friction c of the pivot.", 0.05, 0.0, 1e3, 0},
    {"initial_angle_rad", "rad", "Angle at step 0.", 0.2, -1.5, 1.5, 0},
};
static const hil_signal motion[] = {
    {"angle_rad", "rad", "Angle a from upright.", -1.57, 1.57},
    {"rate_radps", "rad/s", "Its rate.", 0.0, 0.0},
};
static const hil_signal command[] = {{"torque_nm", "N m", "Torque T of the motor.", 0.0, 0.0}};

struct pendulum {
    struct { double mass_kg, length_m, friction_nm_s_per_rad, initial_angle_rad; } p;
    double state[2], torque_nm;
};
static int retune(void *self, const double *row) {
    return memcpy(&((struct pendulum *)self)->p, row, sizeof(double[4])), HIL_OK;
}
static int start(void *self, const double *row) {
    ((struct pendulum *)self)->state[0] = row[3];
    return retune(self, row);
}
static int save(const void *self, void *bytes) {
    return memcpy(bytes, ((const struct pendulum *)self)->state, sizeof(double[2])), HIL_OK;
}
static int restore(void *self, const void *bytes) {
    return memcpy(((struct pendulum *)self)->state, bytes, sizeof(double[2])), HIL_OK;
}
static int measure(const void *self, double *measured) { return save(self, measured); }
static int take_state(void *self, const double *row) { return restore(self, row); }
static int tell_truth(const void *self, double time_s, const double *row, double *truth) {
    return (void)time_s, (void)row, save(self, truth);
}
static void rates(const void *self, double time_s, const double *x, double *dx) {
    const struct pendulum *q = self;
    const double g = 9.80665, m = q->p.mass_kg, l = q->p.length_m, c = q->p.friction_nm_s_per_rad;
    (void)time_s, dx[0] = x[1];
    dx[1] = (m * g * l * hil_sin(x[0]) - c * x[1] + q->torque_nm) / (m * l * l);
}
static int advance(void *self, const hil_interval *interval, const double *row) {
    struct pendulum *q = self;
    return q->torque_nm = row[0], hil_integrate(q->state, 2, interval, rates, q);
}
int main(int argc, char **argv) {
    const hil_plant plant = {
        .api = HIL_API, .name = "pendulum", .version = "0.1.0",
        .summary = "A pendulum on its head, with a motor at its pivot.",
        .parameters = HIL_TABLE(parameters), .commands = HIL_TABLE(command),
        .truth = HIL_TABLE(motion), .measured = HIL_TABLE(motion), .size = sizeof(struct pendulum),
        .start = start, .retune = retune, .measure = measure, .tell_truth = tell_truth,
        .advance = advance, .saved_size = sizeof(double[2]), .save = save, .restore = restore,
        .state = HIL_TABLE(motion), .tell_state = measure, .take_state = take_state};
    return hil_plant_main(argc, argv, &plant);
}
