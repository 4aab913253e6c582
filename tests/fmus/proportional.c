/* An FMU of FMI 3.0 for tests: `force_n = gain (reference_position_m - position_m)`, and, if `trouble` is set, an FMU
 * that misbehaves in its third step. Only what an importer needs of co-simulation without events is there. */

#include <stdio.h>

#include "idle.h"

enum { POSITION = 1, REFERENCE, FORCE, GAIN, TROUBLE, COUNT };
enum { NONE, CRASH, ABORT, EXIT, DISCARD, FAIL, FATAL, TERMINATE, BEYOND, NOT_A_NUMBER, EARLY, LOOP, TALK, ROUND_UP };

typedef struct {
    double position, reference, force, gain;
    int32_t trouble;
    int64_t count;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
    bool broken;
} Instance;

static void say(Instance *one, fmi3Status status, const char *text) {
    if (one->log) {
        one->log(one->environment, status, "logStatusError", text);
    }
}

/* Leaves "round up" behind, without a library that a program may not have loaded. */
static void round_up(void) {
#if defined(__x86_64__)
    unsigned word;
    __asm__ volatile("stmxcsr %0" : "=m"(word));
    word |= 0x4000;
    __asm__ volatile("ldmxcsr %0" : : "m"(word));
#elif defined(__aarch64__)
    unsigned long word;
    __asm__ volatile("mrs %0, fpcr" : "=r"(word));
    __asm__ volatile("msr fpcr, %0" : : "r"(word | 1ul << 22));
#endif
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t count,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)needed, (void)update;
    if (strcmp(token, "proportional") != 0 || events || early || count != 0) {
        return NULL;
    }
    Instance *one = calloc(1, sizeof *one);
    one->gain = 100.0;
    one->log = log;
    one->environment = environment;
    return one;
}

void fmi3FreeInstance(fmi3Instance instance) {
    if (((Instance *)instance)->trouble == FATAL && ((Instance *)instance)->broken) {
        fputs("freed after a fatal answer\n", stderr);
    }
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    (void)tolerance_defined, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    Instance *one = instance;
    if (one->gain > 1000.0) {
        say(one, fmi3Error, "the gain is too large for this drive");
        return fmi3Error;
    }
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    if (((Instance *)instance)->broken) {
        fputs("terminated after an error\n", stderr);
    }
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count, fmi3Float64 values[],
                          size_t n) {
    Instance *one = instance;
    if (n != count) return fmi3Error;
    for (size_t i = 0; i < count; i++) {
        if (refs[i] != FORCE) return fmi3Error;
        values[i] = one->force;
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count,
                          const fmi3Float64 values[], size_t n) {
    Instance *one = instance;
    if (n != count) return fmi3Error;
    for (size_t i = 0; i < count; i++) {
        switch (refs[i]) {
        case POSITION: one->position = values[i]; break;
        case REFERENCE: one->reference = values[i]; break;
        case GAIN: one->gain = values[i]; break;
        default: return fmi3Error;
        }
    }
    return fmi3OK;
}

fmi3Status fmi3GetInt64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count, fmi3Int64 values[],
                        size_t n) {
    (void)refs;
    if (n != count || count != 1) return fmi3Error;
    values[0] = ((Instance *)instance)->count;
    return fmi3OK;
}

fmi3Status fmi3SetInt64(fmi3Instance instance, const fmi3ValueReference refs[], size_t count,
                        const fmi3Int64 values[], size_t n) {
    (void)instance, (void)refs, (void)count, (void)values, (void)n;
    return fmi3Error;
}

fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference refs[], size_t count, fmi3Int32 values[],
                        size_t n) {
    (void)instance, (void)refs, (void)count, (void)values, (void)n;
    return fmi3Error;
}

fmi3Status fmi3SetInt32(fmi3Instance instance, const fmi3ValueReference refs[], size_t count,
                        const fmi3Int32 values[], size_t n) {
    (void)refs;
    if (n != count || count != 1) return fmi3Error;
    ((Instance *)instance)->trouble = values[0];
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 at, fmi3Float64 length, fmi3Boolean never_back,
                      fmi3Boolean *event, fmi3Boolean *over, fmi3Boolean *early, fmi3Float64 *reached) {
    (void)never_back;
    Instance *one = instance;
    *event = *over = *early = false;
    *reached = at + length;
    one->force = one->gain * (one->reference - one->position);
    one->count++;
    if (one->trouble == ROUND_UP) {
        round_up();
        return fmi3OK;
    }
    if (one->count != 3 || one->trouble == NONE) {
        return fmi3OK;
    }
    one->broken = true;
    switch (one->trouble) {
    case CRASH:
        say(one, fmi3Error, "the valve model divides by zero");
        *(volatile int *)0 = 1;
        return fmi3OK;
    case ABORT: abort();
    case EXIT: exit(0);
    case DISCARD: one->broken = false; say(one, fmi3Discard, "the step is too long"); return fmi3Discard;
    case FAIL: say(one, fmi3Error, "the pump cavitates"); return fmi3Error;
    case FATAL: say(one, fmi3Fatal, "the memory is corrupt"); return fmi3Fatal;
    case TERMINATE: one->broken = false; *over = true; return fmi3OK;
    case BEYOND: one->broken = false; one->count = (INT64_C(1) << 53) + 1; return fmi3OK;
    case NOT_A_NUMBER: one->broken = false; one->force = 0.0 / (one->force - one->force); return fmi3OK;
    case EARLY: *early = true; *reached = at; return fmi3OK;
    case LOOP:
        say(one, fmi3Warning, "the solver looks for a root");
        for (volatile int i = 0;; i ^= 1) {
        }
    case TALK: one->broken = false; say(one, fmi3Warning, "the filter clogs"); return fmi3OK;
    default: return fmi3Error;
    }
}
