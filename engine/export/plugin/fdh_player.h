/* One player for any file of a patch. All but create and destroy are for the audio thread: nothing is allocated, locked or
 * waited for. What is told acts at the next sample that is computed. */
#ifndef FDH_PLAYER_H
#define FDH_PLAYER_H

#include "fdh_file.h"

typedef struct fdh_player fdh_player;
enum { FDH_SUSTAIN, FDH_SOSTENUTO, FDH_SOFT, FDH_PEDALS };

/* Make a player at a sample rate: with the tables of the nearest that the file has, and resampled if that is another.
 * NULL: no memory, a damaged file, or a processor that the kernels do not run on; `fault` says which. */
fdh_player *fdh_create(fdh_file *file, double rate, char *fault);
void fdh_destroy(fdh_player *player);
void fdh_reset(fdh_player *player); /* back to the first sample, with the values of the patch */

/* Compute the next frames, channels interleaved. */
void fdh_process(fdh_player *player, float *out, int frames);
int fdh_latency(const fdh_player *player); /* frames; 0 unless it is resampled */
int fdh_is_asleep(const fdh_player *player);
int64_t fdh_lost(const fdh_player *player); /* events that found no room, since the last reset; releases never */
double fdh_energy_error(const fdh_player *player); /* largest, as a share of the largest energy */

int fdh_find_key(const fdh_file *file, int number); /* index of a key by its number of MIDI, or -1 */
int fdh_note_on(fdh_player *player, int key, double velocity); /* 1 to 127; returns 0, or -1 if there was no room */
void fdh_note_off(fdh_player *player, int key);
void fdh_choke(fdh_player *player, int key);
void fdh_silence(fdh_player *player); /* end all sounds of keys */
void fdh_release_all(fdh_player *player);
void fdh_pedal(fdh_player *player, int pedal, int value); /* 0 to 127 */
void fdh_bend(fdh_player *player, double share); /* of the wheel, -1 to 1 */
void fdh_set(fdh_player *player, int control, double value);
double fdh_value(const fdh_player *player, int control);
int fdh_note_ended(fdh_player *player, int key); /* 1 once, when the note of a key has died away after its end */
#endif
