/* The plant `patchy` and the law `watchful` of `tests/shared` in C: one program each, chosen by the macro PLANT. Tests of
 * validity compare their runs with those in Rust. */
#include <hil.h>
#include <math.h>
#include <string.h>

#ifdef PLANT

static const hil_signal truth[] = {{"position_m", "m", "Position.", 0.0, 0.0}};
static const hil_signal measured[] = {
    {"position_m", "m", "Position.", -10.0, 10.0},
    {"rate_mps", "m/s", "Rate, sampled at every fourth step.", 0.0, 0.0},
    {"rate_mps_age_steps", "steps", "Age of the rate.", 0.0, 0.0},
};
static const hil_signal command[] = {{"rate_mps", "m/s", "Rate.", 0.0, 0.0}};

struct patchy {
    double position_m, sampled_mps;
    unsigned step;
};

static int start(void *self, const double *row) { return (void)self, (void)row, HIL_OK; }
static int read_sensors(const void *self, double *row, uint8_t *invalid) {
    const struct patchy *p = self;
    const int is_gap = p->step >= 20 && p->step < 35;
    row[0] = is_gap ? NAN : p->position_m, row[1] = p->sampled_mps, row[2] = p->step % 4;
    invalid[0] = is_gap ? 200 : 0;
    return HIL_OK;
}
static int tell_truth(const void *self, double time_s, const double *row, double *out) {
    return (void)time_s, (void)row, out[0] = ((const struct patchy *)self)->position_m, HIL_OK;
}
static int advance(void *self, const hil_interval *interval, const double *row) {
    struct patchy *p = self;
    p->step++, p->position_m += interval->length_s * row[0];
    if (p->step % 4 == 0) p->sampled_mps = row[0];
    return HIL_OK;
}
int main(int argc, char **argv) {
    const hil_plant plant = {
        .api = HIL_API, .name = "patchy", .summary = "A position with a gap in its measurement.",
        .truth = HIL_TABLE(truth), .measured = HIL_TABLE(measured), .commands = HIL_TABLE(command),
        .size = sizeof(struct patchy), .start = start, .read = read_sensors, .tell_truth = tell_truth,
        .advance = advance};
    return hil_plant_main(argc, argv, &plant);
}

#else

static const hil_signal measured[] = {
    {"position_m", "m", "Position.", 0.0, 0.0},
    {"rate_mps", "m/s", "Rate.", 0.0, 0.0},
};
static const hil_signal command[] = {{"rate_mps", "m/s", "Rate.", 0.0, 0.0}};
static const hil_signal internals[] = {
    {"is_valid", "1", "1 if the position is valid.", 0.0, 0.0},
    {"position_age", "steps", "Age of the position.", 0.0, 0.0},
    {"rate_age", "steps", "Age of the rate.", 0.0, 0.0},
};

static int start(void *self, const hil_setup *setup) { return (void)self, (void)setup, HIL_OK; }
static int answer(void *self, const hil_sample *sample, const hil_quality *quality, double *out, double *inside,
                  uint8_t *held) {
    unsigned *samples = self;
    inside[0] = !quality->measured_invalid[0], inside[1] = quality->age_steps[0], inside[2] = quality->age_steps[1];
    held[0] = *samples >= 50 && *samples < 60;
    if (!held[0]) out[0] = 1.0 - sample->measured[0];
    ++*samples;
    return HIL_OK;
}
int main(int argc, char **argv) {
    const hil_controller law = {
        .api = HIL_API, .name = "watchful", .summary = "Approaches 1 m and shows the quality of its sample.",
        .plant = "patchy", .measured = HIL_TABLE(measured), .commands = HIL_TABLE(command),
        .internals = HIL_TABLE(internals), .size = sizeof(unsigned), .start = start, .answer = answer};
    return hil_controller_main(argc, argv, &law);
}

#endif
