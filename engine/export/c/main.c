/* Write the patch to standard output: 64-bit floating-point numbers, channels interleaved. Heard, for example, by
 *     ./patch | ffplay -f f64le -ar 44100 -ac 1 -
 * or, with a number of samples as the only argument, for so long. With a name instead, ./patch struck.wav, write three
 * seconds of one key, or of the first pad, to a WAV of 32-bit numbers, at the level of the patch; if it gives none, the
 * loudest is at half of full scale. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#endif

#include "fdh.h"
#include "fdh_patch.h"

static int fail(const char *why) {
    fprintf(stderr, "%s\n", why);
    return 1;
}

static int write_wav(FILE *file, const double *audio, uint32_t count) {
    uint32_t rate = fdh_samplerate(), bytes = 4 * count, channels = fdh_channels();
    uint32_t head[11] = {0, 36 + bytes, 0, 0, 16, 3 | channels << 16, rate, 4 * channels * rate, 4 * channels | 32 << 16,
                         0, bytes};
    double peak = 0.0, gain = FDH_GAIN;
    memcpy(head, "RIFF", 4), memcpy(head + 2, "WAVEfmt ", 8), memcpy(head + 9, "data", 4);
    fwrite(head, sizeof head, 1, file);
    for (uint32_t i = 0; i < count; i++) peak = fmax(peak, fabs(audio[i]));
    if (gain == 0.0 && peak > 0.0) gain = 0.5 / peak;
    for (uint32_t i = 0; i < count; i++) {
        float sample = (float)(gain * audio[i]);
        fwrite(&sample, sizeof sample, 1, file);
    }
    return ferror(file) | fclose(file) ? fail("the output cannot be written") : 0;
}

int main(int count, char **words) {
    int is_struck = count > 1 && strstr(words[1], ".wav") != NULL;
    int64_t frames = is_struck ? 3 * fdh_samplerate() : count > 1 ? atoll(words[1]) : fdh_length();
    size_t size = (size_t)frames * fdh_channels();
    double *audio = malloc(sizeof(double) * (size + 1));
    fdh *patch = fdh_create();
    if (patch == NULL || audio == NULL) return fail("there is not enough memory");
#ifdef _WIN32
    _setmode(_fileno(stdout), _O_BINARY); /* or two bytes would be written for each that is 10 */
#endif
    if (is_struck && FDH_KEYS) {
        fdh_skip_score(patch);
        fdh_note_on(patch, FDH_MIDDLE_KEY, 90);
    } else if (is_struck && FDH_PADS) {
        fdh_strike(patch, 0, FDH_FIRST_SIZE);
    }
    fdh_process(patch, audio, (int)frames);
    fprintf(stderr, "energy error %.1e\n", fdh_energy_error(patch));
    fdh_destroy(patch);
    FILE *file = is_struck ? fopen(words[1], "wb") : stdout;
    if (file == NULL) return fail("the output cannot be opened");
    if (is_struck) return write_wav(file, audio, (uint32_t)size);
    return fwrite(audio, sizeof(double), size, file) == size ? 0 : fail("the output cannot be written");
}
