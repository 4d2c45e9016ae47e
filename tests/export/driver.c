/* Play two instances of a patch by lines of standard input, "INSTANCE WORD NUMBERS", and write what they sound to standard
 * output, 64-bit numbers, and what the functions return to standard error. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#endif

#include "fdh.h"

int main(void) {
#ifdef _WIN32
    _setmode(_fileno(stdout), _O_BINARY);
#endif
    fdh *patches[2] = {fdh_create(), fdh_create()};
    char word[16];
    int instance;
    double a, b;
    while (scanf("%d %15s %lf %lf", &instance, word, &a, &b) == 4) {
        fdh *patch = patches[instance];
        int result = 0;
        if (!strcmp(word, "play")) {
            double *out = malloc(sizeof(double) * (size_t)a * fdh_channels());
            fdh_process(patch, out, (int)a);
            fwrite(out, sizeof(double) * fdh_channels(), (size_t)a, stdout);
            free(out);
        }
        if (!strcmp(word, "strike")) result = fdh_strike(patch, (int)a, b);
        if (!strcmp(word, "set")) result = fdh_set(patch, (int)a, b);
        if (!strcmp(word, "on")) result = fdh_note_on(patch, (int)a, (int)b);
        if (!strcmp(word, "off")) result = fdh_note_off(patch, (int)a);
        if (!strcmp(word, "pedal")) result = fdh_pedal(patch, (int)a);
        if (!strcmp(word, "skip")) result = fdh_skip_score(patch);
        if (!strcmp(word, "reset")) fdh_reset(patch);
        fprintf(stderr, "%d ", result);
    }
    fdh_destroy(patches[0]);
    fdh_destroy(patches[1]);
    return 0;
}
