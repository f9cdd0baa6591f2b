/* Steps a skill through a list of states, as binary numbers: from standard input to standard output. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "skill.h"

#define GIVEN (8 + SKILL_DIMENSION)    /* the stage that is begun, six limits, whether it is busy, the state */
#define ANSWERED (3 + SKILL_DIMENSION) /* the code, the part, where in a chain it is, the command */

int main(int count_of_arguments, char **arguments)
{
    const size_t count = count_of_arguments > 2 ? (size_t)atol(arguments[1]) : 0;
    double *given = (double *)malloc(sizeof(double) * GIVEN * count);
    double *answered = (double *)malloc(sizeof(double) * ANSWERED * count);
    skill_controller controller;
    clock_t started;
    size_t k;
    if (given == NULL || answered == NULL || fread(given, sizeof(double) * GIVEN, count, stdin) != count) {
        return 1;
    }
    skill_begin_unproved(&controller, atof(arguments[2]));
    started = clock();
    for (k = 0; k < count; ++k) {
        const double *from = given + GIVEN * k;
        double *to = answered + ANSWERED * k;
        if (from[0] > 0.0) {
            skill_reset(&controller);
        }
        controller.max_speed = from[1];
        controller.max_acceleration = from[2];
        controller.max_jerk = from[3];
#ifdef SKILL_LENGTH
        controller.max_turn = from[4];
        controller.max_turn_acceleration = from[5];
        controller.max_turn_jerk = from[6];
#endif
#ifdef SKILL_STAGES
        if (from[0] > 0.0) {
            skill_go(&controller, (int)from[0] - 1);
        }
        controller.busy = from[7] > 0.0;
#endif
        to[0] = skill_step(&controller, from + 8, to + 3);
        to[1] = controller.part;
        to[2] = 0.0;
#ifdef SKILL_STAGES
        to[2] = 4 * controller.past + 2 * (controller.event != NULL) + controller.done;
#endif
    }
    fprintf(stderr, "%.17g", (double)(clock() - started) / CLOCKS_PER_SEC);
    k = fwrite(answered, sizeof(double) * ANSWERED, count, stdout);
    free(given);
    free(answered);
    return k != count;
}
