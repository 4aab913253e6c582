/* A room that its heater and its surroundings warm, the twin of `tests/examples/heated-room.rs`. */
#include <hil.h>
#include <math.h>
#include <string.h>

static const hil_parameter parameters[] = {
    {"time_constant_s", "s", "Time constant.", 0.5, 1e-3, 1e6, 0},
    {"conductance_w_per_k", "W/K", "Conductance.", 10.0, 1e-3, 1e6, 0},
    {"initial_k", "K", "Temperature at the start.", 300.0, 0.0, 1e4, 0},
};
static const hil_signal temperature[] = {{"room_k", "K", "Temperature of the room.", 0.0, 1e4}};
static const hil_signal commands[] = {
    {"ambient_k", "K", "Ambient temperature.", 100.0, 1000.0},
    {"heating_w", "W", "Heating power.", 0.0, 0.0},
};
static const double starts[] = {280.0, NAN};

struct room {
    double time_constant_s, conductance_w_per_k, initial_k, heated_k, state[1];
};

static int retune(void *self, const double *row) { return memcpy(self, row, sizeof(double[3])), HIL_OK; }
static int start(void *self, const double *row) {
    struct room *room = self;
    retune(self, row);
    room->state[0] = room->initial_k;
    return HIL_OK;
}
static int measure(const void *self, double *row) { return row[0] = ((const struct room *)self)->state[0], HIL_OK; }
static int tell_truth(const void *self, double time_s, const double *row, double *truth) {
    return (void)time_s, (void)row, measure(self, truth);
}
static void rates(const void *self, double time_s, const double *x, double *dx) {
    const struct room *room = self;
    (void)time_s, dx[0] = (room->heated_k - x[0]) / room->time_constant_s;
}
static int advance(void *self, const hil_interval *interval, const double *row) {
    struct room *room = self;
    room->heated_k = row[0] + row[1] / room->conductance_w_per_k;
    return hil_integrate(room->state, 1, interval, rates, room);
}
int main(int argc, char **argv) {
    const hil_plant plant = {
        .api = HIL_API, .name = "heated-room", .summary = "A room that its heater and its surroundings warm.",
        .parameters = HIL_TABLE(parameters), .commands = HIL_TABLE(commands), .truth = HIL_TABLE(temperature),
        .measured = HIL_TABLE(temperature), .size = sizeof(struct room), .start = start, .retune = retune,
        .measure = measure, .tell_truth = tell_truth, .advance = advance, .start_commands = starts};
    return hil_plant_main(argc, argv, &plant);
}
