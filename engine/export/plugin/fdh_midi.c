#include "fdh_midi.h"

enum { SUSTAIN = 64, SOSTENUTO = 66, SOFT = 67, ALL_SOUND_OFF = 120, RESET_CONTROLLERS = 121, ALL_NOTES_OFF = 123, MIDDLE = 8192 };

static void control(fdh_player *player, int number, int value) {
    if (number == SUSTAIN) fdh_pedal(player, FDH_SUSTAIN, value);
    else if (number == SOSTENUTO) fdh_pedal(player, FDH_SOSTENUTO, value);
    else if (number == SOFT) fdh_pedal(player, FDH_SOFT, value);
    else if (number == ALL_SOUND_OFF) fdh_silence(player);
    else if (number >= ALL_NOTES_OFF) fdh_release_all(player); /* 124 to 127 change the mode, and say this, too */
    else if (number == RESET_CONTROLLERS) {
        for (int pedal = 0; pedal < FDH_PEDALS; pedal++) fdh_pedal(player, pedal, 0);
        fdh_bend(player, 0.0);
    }
}

void fdh_midi(fdh_player *player, const fdh_file *file, const uint8_t *message) {
    int kind = message[0] & 0xf0, number = message[1] & 127, value = message[2] & 127;
    if (kind == 0x90 && value) fdh_note_on(player, fdh_find_key(file, number), value);
    else if (kind == 0x80 || kind == 0x90) fdh_note_off(player, fdh_find_key(file, number));
    else if (kind == 0xb0) control(player, number, value);
    else if (kind == 0xe0) {
        int bend = number + 128 * value - MIDDLE;
        fdh_bend(player, (double)bend / (bend < 0 ? MIDDLE : MIDDLE - 1));
    }
}
