/* Write the patch to standard output: 64-bit floating-point numbers, channels interleaved. Heard, for example, by
 *     ./patch | ffplay -f f64le -ar 44100 -ac 1 -
 * or, with a number of samples as the only argument, for so long. */
#include <stdio.h>
#include <stdlib.h>

#include "fdh.h"

enum { BLOCK = 256 };

int main(int count, char **words) {
    int64_t left = count > 1 ? atoll(words[1]) : fdh_length();
    double *block = malloc(sizeof(double) * BLOCK * fdh_channels());
    fdh *patch = fdh_create();
    if (patch == NULL || block == NULL) {
        fprintf(stderr, "there is not enough memory\n");
        return 1;
    }
    while (left > 0) {
        int frames = left < BLOCK ? (int)left : BLOCK;
        fdh_process(patch, block, frames);
        if (fwrite(block, sizeof(double) * fdh_channels(), frames, stdout) != (size_t)frames) {
            fprintf(stderr, "the output cannot be written\n");
            return 1;
        }
        left -= frames;
    }
    fprintf(stderr, "energy error %.1e\n", fdh_energy_error(patch));
    fdh_destroy(patch);
    free(block);
    return 0;
}
