/* An FMU for tests that gives back what it was told at its start: outputs are the tolerance, the start, the stop (-1 where
 * none is told), the time of the last step, the length of a text, and the number of bytes in a file that another text
 * names. Its state `x` moves by its input. */
#include <stdio.h>

#define TOKEN "starts"
enum { TOLERANCE = 1, START, STOP, AT, LENGTH, BYTES, X, U, COUNT, NAME, TABLE, FIRST_SET = X };

#define BEGUN(values, tolerance, start, stop) \
    ((values)[TOLERANCE] = (tolerance), (values)[START] = (start), (values)[STOP] = (stop))
#define REACHED(values, at) ((values)[AT] = (at))

#include "rows.h"

static void advance(double *values, double h) { values[X] += h * values[U]; }

static bool write_text(double *values, unsigned ref, const char *text) {
    if (ref == NAME) {
        values[LENGTH] = (double)strlen(text);
    } else if (ref == TABLE) {
        FILE *file = fopen(text, "r");
        if (file == NULL) return false;
        while (fgetc(file) != EOF) values[BYTES]++;
        fclose(file);
    } else {
        return false;
    }
    return true;
}

#if FMI_VERSION == 2
fmi2Status fmi2GetString(fmi2Component one, const fmi2ValueReference refs[], size_t count, fmi2String values[]) {
    (void)one, (void)refs, (void)count, (void)values;
    return fmi2Error;
}

fmi2Status fmi2SetString(fmi2Component one, const fmi2ValueReference refs[], size_t count, const fmi2String values[]) {
    return count == 1 && write_text(one, refs[0], values[0]) ? fmi2OK : fmi2Error;
}
#else
fmi3Status fmi3GetString(fmi3Instance one, const fmi3ValueReference refs[], size_t count, fmi3String values[],
                         size_t n) {
    (void)one, (void)refs, (void)count, (void)values, (void)n;
    return fmi3Error;
}

fmi3Status fmi3SetString(fmi3Instance one, const fmi3ValueReference refs[], size_t count, const fmi3String values[],
                         size_t n) {
    return count == 1 && n == 1 && write_text(one, refs[0], values[0]) ? fmi3OK : fmi3Error;
}
#endif
