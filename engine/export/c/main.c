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

enum { AT_A_TIME = 4096 }; /* samples of each channel */

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

/* Three seconds of one key, or of the first pad, or of the patch, to a WAV. */
static int write_note(fdh *patch, const char *name) {
    int frames = 3 * fdh_samplerate();
    size_t size = (size_t)frames * fdh_channels();
    double *audio = malloc(sizeof(double) * size);
    if (audio == NULL) return fail("there is not enough memory");
    if (FDH_KEYS) {
        fdh_skip_score(patch);
        fdh_note_on(patch, FDH_MIDDLE_KEY, 90);
    } else if (FDH_PADS) {
        fdh_strike(patch, 0, FDH_FIRST_SIZE);
    }
    fdh_process(patch, audio, frames);
    FILE *file = fopen(name, "wb");
    if (file == NULL) return fail("the output cannot be opened");
    int result = write_wav(file, audio, (uint32_t)size);
    free(audio);
    return result;
}

/* So many samples of the patch, or all of it, to standard output. */
static int write_patch(fdh *patch, int64_t frames) {
    static double audio[AT_A_TIME * FDH_CHANNELS];
    for (int64_t done = 0; done < frames; done += AT_A_TIME) {
        int count = frames - done < AT_A_TIME ? (int)(frames - done) : AT_A_TIME;
        size_t size = (size_t)count * FDH_CHANNELS;
        fdh_process(patch, audio, count);
        if (fwrite(audio, sizeof(double), size, stdout) != size) return fail("the output cannot be written");
    }
    return fflush(stdout) ? fail("the output cannot be written") : 0;
}

int main(int count, char **words) {
    const char *word = count > 1 ? words[1] : "", *ending = strrchr(word, '.');
    int is_wav = ending != NULL && strcmp(ending, ".wav") == 0;
    char *rest = NULL;
    int64_t frames = count > 1 ? strtoll(word, &rest, 10) : fdh_length();
    int is_number = count == 1 || (*word && !*rest && frames >= 0 && frames < INT64_MAX);
    if (count > 2 || !(is_wav || is_number))
        return fail("give nothing, a number of samples from 0 on, or a name that ends in .wav");
    fdh *patch = fdh_create();
    if (patch == NULL) return fail("there is not enough memory");
#ifdef _WIN32
    _setmode(_fileno(stdout), _O_BINARY); /* or two bytes would be written for each that is 10 */
#endif
    int result = is_wav ? write_note(patch, word) : write_patch(patch, frames);
    fprintf(stderr, "energy error %.1e\n", fdh_energy_error(patch));
    fdh_destroy(patch);
    return result;
}
