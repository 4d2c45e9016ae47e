#include "fdh.h"

#include <stdlib.h>
#include <string.h>

#include "fdh_patch.h" /* numbers of this patch */

extern const unsigned char fdh_scene[FDH_SIZE];           /* its tables and its state, at their first sample */
extern const int64_t fdh_pointers[FDH_POINTERS];          /* where pointers stand in it: offsets, until it is copied */
void fdh_render(void *model, void *state, void *output, void *whole, int64_t frames); /* all three in fdh_patch.o */

struct fdh {
    unsigned char *memory, *scene; /* as it was given, and the first place in it that is a multiple of 64 */
};

fdh *fdh_create(void) {
    fdh *patch = calloc(1, sizeof *patch);
    if (patch == NULL) return NULL;
    patch->memory = malloc(FDH_SIZE + 64);
    if (patch->memory == NULL) {
        free(patch);
        return NULL;
    }
    patch->scene = patch->memory + (64 - (uintptr_t)patch->memory % 64) % 64;
    fdh_reset(patch);
    return patch;
}

void fdh_destroy(fdh *patch) {
    if (patch != NULL) free(patch->memory);
    free(patch);
}

void fdh_reset(fdh *patch) {
    memcpy(patch->scene, fdh_scene, FDH_SIZE);
    for (int i = 0; i < FDH_POINTERS; i++) {
        uintptr_t address;
        memcpy(&address, patch->scene + fdh_pointers[i], sizeof address);
        address += (uintptr_t)patch->scene;
        memcpy(patch->scene + fdh_pointers[i], &address, sizeof address);
    }
}

int fdh_channels(void) { return FDH_CHANNELS; }

int fdh_samplerate(void) { return FDH_SAMPLERATE; }

int64_t fdh_length(void) { return FDH_LENGTH; }

void fdh_process(fdh *patch, double *out, int frames) {
    unsigned char *scene = patch->scene;
    while (frames > 0) {
        int count = frames < FDH_BLOCK ? frames : FDH_BLOCK;
        fdh_render(scene + FDH_MODEL, scene + FDH_STATE, scene + FDH_OUTPUT, scene + FDH_WHOLE, count);
        memcpy(out, scene + FDH_AUDIO, sizeof(double) * count * FDH_CHANNELS);
        out += count * FDH_CHANNELS;
        frames -= count;
    }
}

double fdh_energy_error(const fdh *patch) {
    const double *balance = (const double *)(patch->scene + FDH_BALANCE);
    return balance[FDH_LARGEST] > 0.0 ? balance[FDH_MAX_ERROR] / balance[FDH_LARGEST] : 0.0;
}
