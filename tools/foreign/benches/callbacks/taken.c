/* Takes the plant of a program in C instead of running it, for the bench `callbacks`.
 *
 * `hil_sin` and `hil_integrate` are macros for pointers that the bench sets, so that a call is one call as in a program
 * that links the library. */
#include <hil.h>

hil_plant taken;

int hil_plant_main(int argc, char **argv, const hil_plant *plant) {
    (void)argc, (void)argv;
    taken = *plant;
    return 0;
}
