/* A plant and a controller in C that do everything wrong, each deed at its hundredth step; which one it is its file's
 * name says. `MISTAKE` in the environment makes its tables wrong instead. Used by the tests of C programs. */
#include <fenv.h>
#include <hil.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BEHAVES, CRASHES, ABORTS, LEAVES, LOOPS, IS_NO_NUMBER, FORGETS, DIVERGES, FAILS, IS_SILENT, OVERRUNS, TALKS, ROUNDS_UP,
       FLUSHES, LOSES };

static hil_parameter parameters[] = {{"deed", "1", "What it does.", 0.0, 0.0, 20.0, 0}};
static hil_signal truth[] = {{"x_m", "m", "Position.", 0.0, 0.0}, {"v_mps", "m/s", "Velocity.", 0.0, 0.0}};
static hil_signal measured[] = {{"x_m", "m", "Position.", 0.0, 0.0}};
static hil_signal commands[] = {{"u_n", "N", "Force.", 0.0, 0.0}};
static hil_signal internals[] = {{"calls", "1", "Number of calls.", 0.0, 0.0}};

struct side {
    double deed;
    int calls;
};

/* Numbers of the order of 1e-310 become 0. */
static void flush_to_zero(void) {
#if defined(__x86_64__)
    unsigned word;
    __asm__ volatile("stmxcsr %0" : "=m"(word));
    word |= 0x8040;
    __asm__ volatile("ldmxcsr %0" : : "m"(word));
#elif defined(__aarch64__)
    unsigned long word;
    __asm__ volatile("mrs %0, fpcr" : "=r"(word));
    __asm__ volatile("msr fpcr, %0" : : "r"(word | 1ul << 24));
#endif
}

static int does(const struct side *side, double *row) {
    volatile double *volatile nowhere = NULL;
    if (side->calls >= 100 && (int)side->deed == ROUNDS_UP) {
        fesetround(FE_UPWARD);
    }
    if (side->calls >= 100 && (int)side->deed == FLUSHES) {
        flush_to_zero();
    }
    if (side->calls != 100) {
        return HIL_OK;
    }
    switch ((int)side->deed) {
    case CRASHES:
        *nowhere = 1.0;
        break;
    case ABORTS:
        abort();
    case LEAVES:
        exit(0);
    case LOOPS:
        for (volatile int i = 0;; i ^= 1) {
        }
    case IS_NO_NUMBER:
        row[0] = NAN;
        break;
    case DIVERGES:
        return hil_diverged("the spring broke");
    case FAILS:
        return hil_failed("the table of the\nspring is gone");
    case IS_SILENT:
        return 7;
    case OVERRUNS:
        for (int i = 0; i < 100; i++) {
            row[i] = i;
        }
        break;
    case TALKS:
        printf("the spring creaks\n");
        break;
    }
    return HIL_OK;
}

static int retune(void *self, const double *row) {
    ((struct side *)self)->deed = row[0];
    return HIL_OK;
}
static int start(void *self, const double *row) {
    if (row[0] == 20.0) {
        return hil_failed("20 goes with nothing");
    }
    return retune(self, row);
}
static int start_law(void *self, const hil_setup *setup) { return start(self, setup->parameters); }
static void retune_law(void *self, const hil_setup *setup, int jumps) {
    (void)jumps, (void)retune(self, setup->parameters);
}
static int measure(const void *self, double *row) {
    const struct side *side = self;
    if (side->deed == FORGETS && side->calls == 100) {
        return HIL_OK;
    }
    row[0] = side->calls;
    return does(side, row);
}
static int tell_truth(const void *self, double time_s, const double *command, double *row) {
    (void)time_s;
    volatile double tiny = 1e-310;
    row[0] = ((const struct side *)self)->calls;
    row[1] = command[0] + row[0] / 3.0 + 1e300 * (1e8 * (row[0] * tiny));
    return HIL_OK;
}
static int advance(void *self, const hil_interval *interval, const double *command) {
    (void)interval, (void)command;
    ((struct side *)self)->calls++;
    return HIL_OK;
}
static int step(void *self, const hil_sample *sample, double *command, double *internal) {
    struct side *side = self;
    volatile double tiny = 1e-310;
    internal[0] = side->calls + 1e300 * (1e8 * (side->calls * tiny));
    command[0] = 0.1 * sample->time_s;
    const int status = does(side, command);
    side->calls++;
    return status;
}

static int save(const void *self, void *bytes) {
    memcpy(bytes, self, sizeof(struct side));
    return HIL_OK;
}
/* Calls of a side that loses them begin anew. */
static int restore(void *self, const void *bytes) {
    struct side *side = self;
    memcpy(side, bytes, sizeof *side);
    if (side->deed == LOSES) {
        side->calls = 0;
    }
    return HIL_OK;
}

int main(int argc, char **argv) {
    hil_plant plant = {
        .api = HIL_API, .name = "misbehaves", .summary = "Does everything wrong.",
        .parameters = HIL_TABLE(parameters), .truth = HIL_TABLE(truth), .measured = HIL_TABLE(measured),
        .commands = HIL_TABLE(commands), .size = sizeof(struct side), .start = start, .retune = retune,
        .measure = measure, .tell_truth = tell_truth, .advance = advance};
    hil_controller controller = {
        .api = HIL_API, .name = "misbehaves", .summary = "Does everything wrong.",
        .parameters = HIL_TABLE(parameters), .measured = HIL_TABLE(measured), .commands = HIL_TABLE(commands),
        .internals = HIL_TABLE(internals), .size = sizeof(struct side), .start = start_law, .step = step};
    if (strstr(argv[0], "saving")) {
        plant.saved_size = sizeof(struct side), plant.save = save, plant.restore = restore;
    }
    const char *mistake = getenv("MISTAKE");
    if (strstr(argv[0], "controller")) {
        if (mistake) {
            parameters[0].flags = HIL_TUNABLE;
            controller.retune = strcmp(mistake, "retune") == 0 ? NULL : retune_law;
            controller.tuning = strcmp(mistake, "tuning") == 0 ? NULL : "The deed is another from then on.";
        }
        return hil_controller_main(argc, argv, &controller);
    }
    if (mistake) {
        const char *const known[] = {"twice", "unit", "no-unit", "name", "null-name", "null-rows", "callback", "range",
                                     "default", "flags", "api", "utf-8", "saving", "text", "null", "retune"};
        size_t which = 0;
        while (strcmp(known[which], mistake) != 0) {
            which++;
        }
        switch (which) {
        case 0: truth[1].name = "x_m"; break;
        case 1: truth[1].unit = "m]"; break;
        case 2: truth[1].unit = ""; break;
        case 3: truth[1].name = "2 m"; break;
        case 4: truth[1].name = NULL; break;
        case 5: plant.measured.rows = NULL; break;
        case 6: plant.advance = NULL; break;
        case 7: parameters[0].min = 30.0; break;
        case 8: parameters[0].initial = 21.0; break;
        case 9: parameters[0].flags = 64; break;
        case 10: plant.api = 99; break;
        case 11: plant.summary = "\xff"; break;
        case 12: plant.saved_size = 8; break;
        case 13: measured[0].description = ""; break;
        case 14: return hil_plant_main(argc, argv, NULL);
        case 15: parameters[0].flags = HIL_TUNABLE, plant.retune = NULL; break;
        }
    }
    return hil_plant_main(argc, argv, &plant);
}
