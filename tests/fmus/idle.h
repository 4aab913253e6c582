/* Functions of FMI 3.0 that have nothing to do in the FMUs of tests. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

const char *fmi3GetVersion(void) { return "3.0"; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String names[]) {
    (void)instance, (void)on, (void)count, (void)names;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { (void)instance; return fmi3OK; }
