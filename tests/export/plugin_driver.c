/* Plays .fdh files as a host would, without any format of plug-ins: plugin_driver RATE FILE...; for each file a line says how
 * it ended, what kernels have changed of the numbers that all players share, and a checksum of the samples. Files may come on standard input. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fdh_midi.h"

#ifdef FDH_COUNT /* linked with --wrap=malloc,--wrap=calloc,--wrap=realloc,--wrap=free: what is called while it plays */
static int is_playing;
static long calls;
void *__real_malloc(size_t), *__real_calloc(size_t, size_t), *__real_realloc(void *, size_t);
void __real_free(void *);
void *__wrap_malloc(size_t size) { return calls += is_playing, __real_malloc(size); }
void *__wrap_calloc(size_t count, size_t size) { return calls += is_playing, __real_calloc(count, size); }
void *__wrap_realloc(void *old, size_t size) { return calls += is_playing, __real_realloc(old, size); }
void __wrap_free(void *old) { calls += is_playing, __real_free(old); }
#else
static int is_playing;
static const long calls = 0;
#endif

static long changed_words(fdh_file *file, const fdh_rate *at) {
    int64_t size = at->shared_size;
    unsigned char *now = malloc((size_t)size + 8);
    long changed = 0;
    memcpy(now, at->shared, (size_t)size);
    int index = (int)(at - file->at);
    fdh_release_rate(file, at); /* of the last player: unpacked anew, it is as it was written */
    const fdh_rate *fresh = fdh_take_rate(file, index);
    for (int64_t n = 0; fresh && n < size; n += 8) changed += memcmp(now + n, fresh->shared + n, 8) != 0;
    free(now);
    if (fresh) fdh_release_rate(file, fresh);
    return changed;
}

static uint32_t play(fdh_player *player, const fdh_file *file) {
    uint32_t sum = 2166136261u;
    static float out[512 * 64];
    for (int n = 0; n < file->keys && n < 12; n++) fdh_note_on(player, n, 10.0 * n + 7.5);
    for (int block = 0; block < 24; block++) {
        int frames = block % 2 ? 512 : 1;
        fdh_process(player, out, frames);
        for (size_t n = 0; n < sizeof(float) * (size_t)(frames * file->channels); n++) sum = (sum ^ ((unsigned char *)out)[n]) * 16777619u;
        uint8_t messages[][3] = {{0xb0, 64, 127}, {0x90, 60, 99}, {0xe0, 0, 100}, {0xb0, 66, 127}, {0xb0, 64, 30}, {0x80, 60, 1},
                                 {0xb0, 67, 127}, {0x90, 62, 12}, {0xb0, 120, 0}, {0xb0, 121, 0}, {0xb0, 123, 0}, {0xe0, 0, 64}};
        fdh_midi(player, file, messages[block / 2]);
        for (int n = 0; n < file->controls && block == 11; n++) fdh_set(player, n, file->about_controls[n].high);
        for (int n = 0; n < file->keys; n++) fdh_note_ended(player, n);
    }
    fdh_is_asleep(player);
    return sum;
}

int main(int count, char **words) {
    char path[1024], fault[FDH_FAULT];
    double rate = atof(words[1]);
    for (int n = 2; n < count || (count == 2 && fgets(path, sizeof path, stdin)); n++) {
        if (count > 2) snprintf(path, sizeof path, "%s", words[n]);
        else path[strcspn(path, "\n")] = 0;
        fdh_file *file = fdh_open(path);
        fdh_player *player = file ? fdh_create(file, rate, fault) : NULL;
        if (!player) printf("refused: %s\n", fault);
        else {
            is_playing = 1;
            uint32_t sum = play(player, file);
            fdh_reset(player);
            is_playing = 0;
            int index = 0;
            for (int k = 0; k < file->rate_count; k++) index = file->at[k].players ? k : index;
            const fdh_rate *at = fdh_take_rate(file, index);
            int is_again = play(player, file) == sum;
            fdh_destroy(player);
            printf("played, %ld changed, %ld calls, %s%08x\n", changed_words(file, at), calls, is_again ? "" : "not again ", sum);
        }
        fdh_close(file);
    }
    return 0;
}
