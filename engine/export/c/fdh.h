/* A patch of fdh-engine in C. Link fdh.c, fdh_patch.o and the C library; nothing else is needed.
 *
 * A patch may be created any number of times; each sounds by itself, and threads need no locks between them. */
#ifndef FDH_H
#define FDH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct fdh fdh;

/* Make the patch, at its first sample. Returns NULL if there is no memory. */
fdh *fdh_create(void);

/* Free it. NULL is allowed. */
void fdh_destroy(fdh *patch);

/* Go back to the first sample. No memory is asked for. */
void fdh_reset(fdh *patch);

/* Number of channels; they are interleaved. */
int fdh_channels(void);

/* Samples per second. The patch is made for these, and sounds at no others. */
int fdh_samplerate(void);

/* Number of samples that the patch lasts, as it says. It may be computed beyond. */
int64_t fdh_length(void);

/* Compute the next samples: frames * channels numbers, those of `engine.render(…).audio`, in SI units.
 * No memory is asked for, and nothing waits, so that an audio callback may call it. */
void fdh_process(fdh *patch, double *out, int frames);

/* Largest error of the energy so far, as a share of the largest energy. Beyond 1e-9, something is wrong. */
double fdh_energy_error(const fdh *patch);

#ifdef __cplusplus
}
#endif
#endif
