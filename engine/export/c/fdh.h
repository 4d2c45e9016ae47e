/* A patch of fdh-engine in C. Link fdh.c, fdh_patch.o and the C library; nothing else is needed.
 *
 * A patch may be created any number of times; each sounds by itself, and threads need no locks between them. Of one
 * patch, one thread may call fdh_process while another strikes, plays keys and sets sliders. */
#ifndef FDH_H
#define FDH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct fdh fdh;

/* What the functions return that may be refused. A call that is refused changes nothing. */
enum {
    FDH_DONE = 0,
    FDH_UNKNOWN = -1,      /* the patch has no such key, pad or slider */
    FDH_OUT_OF_RANGE = -2, /* the velocity or the value is not a number, too large or too small */
    FDH_FULL = -3          /* its events have no room: FDH_QUEUE of them wait for fdh_process at most. fdh_patch.h says how
                            * many a call makes: a note (on, off, and ended for another) FDH_EVENTS_OF_NOTE, a stroke
                            * FDH_EVENTS_OF_STROKE, fdh_set FDH_EVENTS_OF_SETTING; the pedal those of all keys it ends */
};

/* Make the patch, at its first sample. Returns NULL if there is no memory. */
fdh *fdh_create(void);

/* Free it. NULL is allowed. */
void fdh_destroy(fdh *patch);

/* Go back to the first sample, with no key pressed and the values of the patch. No memory is allocated. No other thread
 * may use the patch meanwhile. */
void fdh_reset(fdh *patch);

/* Number of channels; they are interleaved. */
int fdh_channels(void);

/* Samples per second. The patch is made for these, and sounds at no others. */
int fdh_samplerate(void);

/* Number of samples that the patch lasts, as it says. It may be computed beyond. */
int64_t fdh_length(void);

/* Compute the next samples: frames * channels numbers, in SI units. As long as nothing below is called, they are those
 * of `fdh.render(…).audio`. No memory is allocated, and nothing waits, so that an audio callback may call it. */
void fdh_process(fdh *patch, double *out, int frames);

/* Largest error of the energy so far, as a share of the largest energy; read every 64 samples. Beyond 1e-9, something
 * is wrong. */
double fdh_energy_error(const fdh *patch);

/* What follows is heard from the first sample of the next fdh_process. fdh_patch.h names the keys, pads and sliders. */

/* Throw a hammer or pluck a body of a patch without keys. pad: FDH_PAD_…; size: velocity of a hammer in m/s, or how many
 * times as strong as in the patch a pluck is. Returns FDH_DONE, FDH_UNKNOWN, FDH_OUT_OF_RANGE or FDH_FULL. */
int fdh_strike(fdh *patch, int pad, double size);

/* Press a key of an instrument. key: number of MIDI, 60 is C4; velocity: 1 to 127. The notes of the score sound on other
 * strings than the keys. Returns FDH_DONE, FDH_UNKNOWN, FDH_OUT_OF_RANGE or FDH_FULL. */
int fdh_note_on(fdh *patch, int key, int velocity);

/* Let a key go: it comes up when it was let go as often as pressed. Nothing happens if it is not pressed. Returns
 * FDH_DONE, FDH_UNKNOWN or FDH_FULL. */
int fdh_note_off(fdh *patch, int key);

/* Move the sustain pedal of an instrument: down if not 0. Returns FDH_DONE, FDH_UNKNOWN without keys, or FDH_FULL. */
int fdh_pedal(fdh *patch, int down);

/* Do not play the score of an instrument: its keys alone sound from now on, up to fdh_reset. Returns FDH_DONE, or
 * FDH_UNKNOWN without keys. */
int fdh_skip_score(fdh *patch);

/* Set a number of the patch, or of the keys of an instrument, in SI units; it glides for 20 ms. slider: FDH_SLIDER_….
 * Returns FDH_DONE, FDH_UNKNOWN, FDH_OUT_OF_RANGE or FDH_FULL. */
int fdh_set(fdh *patch, int slider, double value);

#ifdef __cplusplus
}
#endif
#endif
