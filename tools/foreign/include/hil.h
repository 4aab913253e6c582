/* hil.h: plants and controllers in C11 or C++.
 *
 * A plant or a controller is tables of its signals and parameters, callbacks, and a `main` of one line.
 * Its program links libhil_foreign.a, and hil starts it as any other (docs/c.md).
 *
 * A row is an array of double in the order of its table; a struct of doubles has the same layout.
 * Rows that a callback writes hold NaN before: a value that is forgotten is named.
 *
 * For one digest everywhere: no clock, no file, no random number; hil_sin and its like below in place of those of
 * <math.h>, whose last bit depends on the machine; and compile with -ffp-contract=off. After each callback the library
 * puts the rounding mode and flush-to-zero back to the default.
 */
#ifndef HIL_H
#define HIL_H

#include <float.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __FAST_MATH__
#error "-ffast-math changes digests; compile without it"
#endif
#ifdef __ASSOCIATIVE_MATH__
#error "-fassociative-math and -funsafe-math-optimizations change digests; compile without them"
#endif
#ifdef __RECIPROCAL_MATH__
#error "-freciprocal-math and -funsafe-math-optimizations change digests; compile without them"
#endif
#ifdef __NO_SIGNED_ZEROS__
#error "-fno-signed-zeros changes digests; compile without it"
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "-ffinite-math-only changes digests; compile without it"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0
#error "double has to be computed as double, not as on the x87 unit; compile for SSE2, without -mfpmath=387"
#endif
#ifdef __clang__
/* Clang has no macros for most of these options: this switches them off in the rest of the file. */
#if defined(__x86_64__) || __clang_major__ >= 19
#pragma float_control(precise, on)
#else /* an older Clang has no more for other processors */
#pragma clang fp reassociate(off)
#endif
#pragma clang fp contract(off)
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Version of this header, for the member `api`. A library of an older version refuses the program; programs compiled
 * with version 1, whose structs end before `read` and `answer`, and with version 2, whose structs end before `state`, go
 * on to work. */
#define HIL_API 3u

/* Tables. */

/* Flags of a parameter. */
enum {
    HIL_FAULTABLE = 1, /* a fault may change it while the plant runs, and `hil set` too */
    HIL_TUNABLE = 2    /* `hil set` may change it while the plant or the controller runs */
};

typedef struct hil_parameter {
    const char *name;        /* ends with the unit, for example "mass_kg"; a group stands in front, "motor.mass_kg" */
    const char *unit;        /* for example "kg", "N m", "m/s2"; "1" for a number without one */
    const char *description; /* one sentence */
    double initial;          /* value that it has when a scenario says nothing */
    double min, max;         /* range; both 0: any number */
    unsigned flags;          /* sum of flags, or 0 */
} hil_parameter;

typedef struct hil_signal {
    const char *name, *unit, *description; /* as above */
    double min, max; /* range, both 0: any number; a plant whose truth leaves it has diverged */
} hil_signal;

typedef struct hil_parameters {
    const hil_parameter *rows;
    size_t count;
} hil_parameters;

typedef struct hil_signals {
    const hil_signal *rows;
    size_t count;
} hil_signals;

/* The table of an array. A table that is left out is empty. */
#define HIL_TABLE(array) { (array), sizeof(array) / sizeof((array)[0]) }

/* Answers of a callback. One that is neither 0 nor HIL_DIVERGED counts as HIL_FAILED. */
enum {
    HIL_OK = 0,
    HIL_DIVERGED = 1, /* the plant left the range where its equations mean something */
    HIL_FAILED = 2    /* it cannot go on; in `start`: the parameters do not go together */
};

/* Keep a reason for the answer and return it: `return hil_failed("the rod broke");`. The text is copied. */
int hil_diverged(const char *reason);
int hil_failed(const char *reason);

/* A plant. */

typedef struct hil_interval {
    double start_s, length_s; /* simulated time and length of the step */
    uint32_t substeps;        /* equal parts to integrate in, as the scenario says */
} hil_interval;

/* Called in this order: `start`; at every step `retune` if a parameter was changed, `measure`, and with the
 * command `tell_truth` and `advance`; after the last step `measure` and `tell_truth` once more.
 * `self` is memory of the plant's own, all zero before `start`. */
typedef struct hil_plant {
    uint32_t api;        /* HIL_API */
    const char *name;    /* plant.model of a scenario */
    const char *summary; /* one sentence */
    const char *version; /* of the program; may be NULL */
    hil_parameters parameters;
    hil_signals truth, measured, commands;
    size_t size; /* bytes of `self` */
    int (*start)(void *self, const double *parameters);
    int (*retune)(void *self, const double *parameters); /* may be NULL without parameters */
    int (*measure)(const void *self, double *measured);
    int (*tell_truth)(const void *self, double time_s, const double *command, double *truth);
    int (*advance)(void *self, const hil_interval *interval, const double *command);
    /* For checkpoints; all three or none. The bytes are not aligned: use memcpy. */
    size_t saved_size;
    int (*save)(const void *self, void *bytes);
    int (*restore)(void *self, const void *bytes);
    void (*end)(void *self); /* after the last call, where start gave HIL_OK; may be NULL */
    /* Called instead of `measure`, if set; `measure` may be NULL then. `invalid` has a byte for each measured signal, 0
     * before: any other number marks it as invalid, as a sensor that has failed, and its value does not matter. */
    int (*read)(const void *self, double *measured, uint8_t *invalid);
    /* Start value of each command, NAN where there is none; may be NULL. A scenario names it in [plant.inputs], as
     * T_AMB = "start", for an input that no law commands, and the law `hold` begins with it. */
    const double *start_commands;
    /* Names of the numbers of the state, for `hil trim` and `hil linearise`; all three or none, and only with `save`.
     * What is no number, as a flag or a count, stays as `restore` left it. */
    hil_signals state;
    int (*tell_state)(const void *self, double *numbers);
    int (*take_state)(void *self, const double *numbers);
} hil_plant;

/* `int main(int argc, char **argv) { return hil_plant_main(argc, argv, &plant); }` */
int hil_plant_main(int argc, char **argv, const hil_plant *plant);

/* A controller. */

typedef struct hil_setup {
    const double *parameters;
    const double *model; /* what the controller believes of the plant */
    double period_s;     /* time between two samples */
} hil_setup;

typedef struct hil_sample {
    double time_s;
    const double *measured, *reference;
    int valid;           /* 0 if a signal of these is marked invalid */
    uint32_t held_steps; /* steps for which a late command has been held; 0 except against the clock */
} hil_sample;

/* Quality of the signals of a sample, in the order of the controller's tables. */
typedef struct hil_quality {
    const uint8_t *measured_invalid, *reference_invalid; /* 1 for a signal that is marked invalid, else 0 */
    const uint32_t *age_steps;                           /* of each measured signal */
} hil_quality;

/* Called in this order: `start`; with every sample `retune` if a parameter was changed, and `step`. `self` as of a
 * plant. Parameters that are HIL_TUNABLE need `retune` and `tuning`. */
typedef struct hil_controller {
    uint32_t api;        /* HIL_API */
    const char *name;    /* controller.law of a scenario */
    const char *summary; /* one sentence */
    const char *version; /* of the program; may be NULL */
    const char *plant;   /* plant that it is made for; NULL: any */
    hil_parameters parameters, model;
    hil_signals measured, reference, commands, internals;
    size_t size; /* bytes of `self` */
    int (*start)(void *self, const hil_setup *setup);
    int (*step)(void *self, const hil_sample *sample, double *command, double *internals);
    /* Takes new values ahead of the sample that they count from; `jumps` is 0 if all that change are on a ramp. Whether
     * they go together `start` was asked before, of another `self`. */
    void (*retune)(void *self, const hil_setup *setup, int jumps);
    const char *tuning; /* what the command does at a change, one sentence for whoever tunes it */
    /* As of a plant. */
    size_t saved_size;
    int (*save)(const void *self, void *bytes);
    int (*restore)(void *self, const void *bytes);
    void (*end)(void *self);
    /* Called instead of `step`, if set; `step` may be NULL then. `held` has a byte for each command, 0 before: with any
     * other number the plant keeps what it last applied of that command, and its value does not matter. */
    int (*answer)(void *self, const hil_sample *sample, const hil_quality *quality, double *command, double *internals,
                  uint8_t *held);
    /* As of a plant. */
    hil_signals state;
    int (*tell_state)(const void *self, double *numbers);
    int (*take_state)(void *self, const double *numbers);
} hil_controller;

int hil_controller_main(int argc, char **argv, const hil_controller *controller);

/* Mathematics. */

/* Rates of change of a state at a time. */
typedef void (*hil_rates)(const void *context, double time_s, const double *state, double *rates);

/* Integrates over an interval in its substeps: Runge-Kutta of order 4, up to HIL_MOST_STATES numbers. */
enum { HIL_MOST_STATES = 64 };
int hil_integrate(double *state, size_t count, const hil_interval *interval, hil_rates rates, const void *context);

/* The same last bit on every machine. */
double hil_sin(double x);
double hil_cos(double x);
double hil_tan(double x);
double hil_asin(double x);
double hil_acos(double x);
double hil_atan(double x);
double hil_atan2(double y, double x);
double hil_sinh(double x);
double hil_cosh(double x);
double hil_tanh(double x);
double hil_exp(double x);
double hil_expm1(double x);
double hil_log(double x);
double hil_log10(double x);
double hil_pow(double x, double y);

#ifdef __cplusplus
}
#endif

#endif
