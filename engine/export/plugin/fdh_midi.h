#ifndef FDH_MIDI_H
#define FDH_MIDI_H

#include "fdh_player.h"

/* Do what a message of MIDI says. */
void fdh_midi(fdh_player *player, const fdh_file *file, const uint8_t *message);
#endif
