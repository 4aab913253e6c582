/* State feedback for a pendulum: T = -m g l sin a - k_1 (a - a_wanted) - k_2 a'. */
#include <hil.h>

static const hil_parameter gains[] = {
    {"angle_nm_per_rad", "N m/rad", "Gain k_1 on the angle.", 9.0, 0.0, 1e6, HIL_TUNABLE},
    {"rate_nm_s_per_rad", "N m s/rad", "Gain k_2 on the rate.", 2.95, 0.0, 1e6, HIL_TUNABLE},
};
static const hil_parameter model[] = {
    {"mass_kg", "kg", "Mass m.", 1.0, 1e-3, 1e3, 0},
    {"length_m", "m", "Length l.", 0.5, 1e-2, 1e2, 0},
};
static const hil_signal measured[] = {
    {"angle_rad", "rad", "Angle a from upright.", 0.0, 0.0},
    {"rate_radps", "rad/s", "Its rate.", 0.0, 0.0},
};
static const hil_signal reference[] = {{"angle_rad", "rad", "Wanted angle.", 0.0, 0.0}};
static const hil_signal command[] = {{"torque_nm", "N m", "Torque T of the motor.", 0.0, 0.0}};

struct state_feedback {
    double k_1, k_2, weight_nm;
};

static int start(void *self, const hil_setup *setup) {
    struct state_feedback *law = self;
    law->k_1 = setup->parameters[0];
    law->k_2 = setup->parameters[1];
    law->weight_nm = setup->model[0] * 9.80665 * setup->model[1];
    return HIL_OK;
}
static void retune(void *self, const hil_setup *setup, int jumps) {
    (void)jumps;
    start(self, setup);
}
static int step(void *self, const hil_sample *sample, double *torque_nm, double *internals) {
    const struct state_feedback *law = self;
    const double a = sample->measured[0], a_dot = sample->measured[1];
    const double feedback_nm = law->k_1 * (a - sample->reference[0]) + law->k_2 * a_dot;
    (void)internals;
    torque_nm[0] = -law->weight_nm * hil_sin(a) - feedback_nm;
    return HIL_OK;
}

int main(int argc, char **argv) {
    const hil_controller controller = {
        .api = HIL_API, .name = "state-feedback", .version = "0.1.0",
        .summary = "Cancels gravity and feeds angle and rate back.",
        .parameters = HIL_TABLE(gains), .model = HIL_TABLE(model),
        .measured = HIL_TABLE(measured), .reference = HIL_TABLE(reference),
        .commands = HIL_TABLE(command), .size = sizeof(struct state_feedback),
        .start = start, .step = step,
        .retune = retune, .tuning = "The torque jumps with a gain.",
    };
    return hil_controller_main(argc, argv, &controller);
}
