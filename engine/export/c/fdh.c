/* For GCC and Clang: threads see each other's numbers by their __atomic functions. */
#include "fdh.h"

#include <stdlib.h>
#include <string.h>

#include "fdh_patch.h" /* numbers of this patch */

/* --- what is in fdh_patch.o */

typedef struct {
    int64_t number[8]; /* as the engine's queue of events has them; FDH_START: frame, counted from now */
    double value[FDH_VALUES];
} row;
typedef struct {
    int64_t first, count;
} rows;
typedef struct {
    int64_t number, group; /* keys of one group, if it is not negative, sound one at a time */
    rows on[FDH_LEVELS], off[FDH_LEVELS], damp, lift, steal;
} key;
typedef struct {
    int64_t at_zero, at_one, count; /* of a pad, rows for a size of 0 and of 1: others lie on a line through these */
    double low, high;
    double shift, part, unit, compliance, most; /* of a slider, the law of the values of its rows */
} control;

extern const row fdh_rows[];
extern const key fdh_keys[];
extern const control fdh_controls[]; /* pads, then sliders */
extern const int64_t fdh_levels[FDH_LEVELS];
extern const unsigned char fdh_scene_score[], fdh_scene_keys[];
extern const int64_t fdh_pointers_score[], fdh_pointers_keys[];
FDH_KERNELS /* declares the functions that FDH_LAYOUTS names */

typedef int64_t (*play_into)(void *memory, int64_t output, int64_t frames);

/* A part of the patch: the memory of a player of the engine. An instrument has two: its score, and its keys. */
typedef struct {
    const unsigned char *scene; /* at its first sample */
    const int64_t *pointers;    /* places of addresses in it; they count from its beginning */
    void (*play)(void), (*render)(void), (*insert)(void);
    int64_t size, pointer_count, memory, render_at, insert_at, counters, events, values, audio, spare, balance;
} layout;
static const layout LAYOUTS[FDH_PARTS] = {FDH_LAYOUTS};

/* --- a patch */

typedef struct {
    int pedal;
    int64_t presses, pressed[FDH_KEYS + 1]; /* which press of a key sounds; 0: none */
    int velocity[FDH_KEYS + 1]; /* with which a key was pressed last */
    char down[FDH_KEYS + 1];
    int presses_of[FDH_KEYS + 1]; /* how often a key that is down was pressed: it is held as often */
} keyboard;

struct fdh {
    unsigned char *memory, *parts[FDH_PARTS]; /* as it was given, and places in it that are multiples of 64 */
    int skips_score;
    keyboard keyboard;
};

static int64_t *counter(const fdh *patch, int part, int slot) {
    return (int64_t *)(patch->parts[part] + LAYOUTS[part].counters) + slot;
}

fdh *fdh_create(void) {
    fdh *patch = calloc(1, sizeof *patch);
    size_t size = 64;
    if (patch == NULL) return NULL;
    for (int n = 0; n < FDH_PARTS; n++) size += LAYOUTS[n].size + 64;
    patch->memory = malloc(size);
    if (patch->memory == NULL) {
        free(patch);
        return NULL;
    }
    unsigned char *place = patch->memory;
    for (int n = 0; n < FDH_PARTS; n++) {
        patch->parts[n] = place + (64 - (uintptr_t)place % 64) % 64;
        place = patch->parts[n] + LAYOUTS[n].size;
    }
    fdh_reset(patch);
    return patch;
}

void fdh_destroy(fdh *patch) {
    if (patch != NULL) free(patch->memory);
    free(patch);
}

void fdh_reset(fdh *patch) {
    for (int n = 0; n < FDH_PARTS; n++) {
        const layout *part = LAYOUTS + n;
        unsigned char *scene = patch->parts[n];
        memcpy(scene, part->scene, part->size);
        for (int64_t i = 0; i < part->pointer_count; i++) *(int64_t *)(scene + part->pointers[i]) += (intptr_t)scene;
        *(int64_t *)(scene + part->render_at) = (intptr_t)part->render;
        *(int64_t *)(scene + part->insert_at) = (intptr_t)part->insert;
    }
    memset(&patch->keyboard, 0, sizeof patch->keyboard);
    patch->skips_score = 0;
}

int fdh_channels(void) { return FDH_CHANNELS; }

int fdh_samplerate(void) { return FDH_SAMPLERATE; }

int64_t fdh_length(void) { return FDH_LENGTH; }

/* Keys run from the beginning, so that their frames are those of live sound; at rest they cost next to nothing. */
static int sounds(const fdh *patch, int part) {
    return part > 0 || !__atomic_load_n(&patch->skips_score, __ATOMIC_RELAXED);
}

void fdh_process(fdh *patch, double *out, int frames) {
    while (frames > 0) {
        int count = frames < FDH_BLOCK ? frames : FDH_BLOCK, size = count * FDH_CHANNELS, summed = 0;
        for (int n = 0; n < FDH_PARTS; n++) {
            if (!sounds(patch, n)) continue;
            unsigned char *scene = patch->parts[n];
            const double *audio = (const double *)(scene + LAYOUTS[n].audio);
            play_into play = (play_into)LAYOUTS[n].play;
            play(scene + LAYOUTS[n].memory, (intptr_t)(scene + LAYOUTS[n].spare), count);
            for (int i = 0; i < size; i++) out[i] = summed ? out[i] + audio[i] : audio[i];
            summed = 1;
        }
        if (!summed) memset(out, 0, sizeof(double) * size);
        out += size;
        frames -= count;
    }
}

double fdh_energy_error(const fdh *patch) {
    double largest = 0.0;
    for (int n = 0; n < FDH_PARTS; n++) {
        const double *balance = (const double *)(patch->parts[n] + LAYOUTS[n].balance);
        double error = balance[FDH_LARGEST] > 0.0 ? balance[FDH_MAX_ERROR] / balance[FDH_LARGEST] : 0.0;
        if (error > largest) largest = error;
    }
    return largest;
}

/* --- events: they go to the last part, through its queue */

enum { EVENTS_TO = FDH_PARTS - 1 };

typedef struct {
    fdh *patch;
    int64_t begin, end; /* indices in the queue */
} message;

static message begin_message(fdh *patch) {
    int64_t index = *counter(patch, EVENTS_TO, FDH_WRITE_INDEX);
    return (message){patch, index, index};
}

/* Rows that are still in the queue, with those of a message. */
static int64_t waiting(const message *sent) {
    return sent->end - __atomic_load_n(counter(sent->patch, EVENTS_TO, FDH_READ_INDEX), __ATOMIC_ACQUIRE);
}

/* Add rows to a message, with values between two rows and beyond: a share of 0 is the first, of 1 the second. */
static void add(message *sent, const row *from, const row *to, int64_t count, double share) {
    unsigned char *scene = sent->patch->parts[EVENTS_TO];
    int64_t frame = __atomic_load_n(counter(sent->patch, EVENTS_TO, FDH_FRAME), __ATOMIC_ACQUIRE);
    for (int64_t i = 0; i < count; i++, sent->end++) {
        if (waiting(sent) >= FDH_QUEUE) continue; /* it will be refused as a whole */
        int64_t slot = sent->end % FDH_QUEUE, *event = (int64_t *)(scene + LAYOUTS[EVENTS_TO].events) + FDH_EVENT * slot;
        double *value = (double *)(scene + LAYOUTS[EVENTS_TO].values) + FDH_VALUES * slot;
        memset(event, 0, sizeof(int64_t) * FDH_EVENT);
        memcpy(event, from[i].number, sizeof from[i].number);
        if (event[FDH_START] > 0) event[FDH_START] += frame;
        for (int k = 0; k < FDH_VALUES; k++) value[k] = from[i].value[k] + share * (to[i].value[k] - from[i].value[k]);
    }
}

static void add_rows(message *sent, rows added) {
    add(sent, fdh_rows + added.first, fdh_rows + added.first, added.count, 0.0);
}

/* Let the audio thread see all rows of a message, or none if there is no room. */
static int send(const message *sent) {
    if (waiting(sent) > FDH_QUEUE) return FDH_FULL;
    __atomic_store_n(counter(sent->patch, EVENTS_TO, FDH_WRITE_INDEX), sent->end, __ATOMIC_RELEASE);
    return FDH_DONE;
}

int fdh_strike(fdh *patch, int pad, double size) {
    if (pad < 0 || pad >= FDH_PADS) return FDH_UNKNOWN;
    const control *moved = fdh_controls + pad;
    if (!(size >= moved->low && size <= moved->high)) return FDH_OUT_OF_RANGE;
    message sent = begin_message(patch);
    add(&sent, fdh_rows + moved->at_zero, fdh_rows + moved->at_one, moved->count, size);
    return send(&sent);
}

/* The value of the rows of a slider, with the roundings of live sound. */
static double value_of_rows(const control *moved, double value) {
    if (moved->compliance == 0.0) return (value - moved->shift) / moved->part / moved->unit;
    volatile double share = value * moved->compliance; /* no compiler fuses it with what follows */
    return value / (1.0 - (share < moved->most ? share : moved->most));
}

int fdh_set(fdh *patch, int slider, double value) {
    if (slider < 0 || slider >= FDH_SLIDERS) return FDH_UNKNOWN;
    const control *moved = fdh_controls + FDH_PADS + slider;
    if (!(value >= moved->low && value <= moved->high)) return FDH_OUT_OF_RANGE;
    message sent = begin_message(patch);
    for (int64_t i = 0; i < moved->count; i++) {
        row set = fdh_rows[moved->at_zero + i];
        set.value[0] = value_of_rows(moved, value);
        add(&sent, &set, &set, 1, 0.0);
    }
    return send(&sent);
}

/* --- keys */

static int find_key(int number) {
    for (int n = 0; n < FDH_KEYS; n++)
        if (fdh_keys[n].number == number) return n;
    return -1;
}

/* Add rows of a key at a velocity, of which there are those of a few. */
static void add_at(message *sent, const rows *of_levels, int velocity) {
    int level = 0;
    while (fdh_levels[level] < velocity) level++;
    const rows *above = of_levels + level;
    if (fdh_levels[level] == velocity || above[-1].count != above->count) {
        add_rows(sent, *above);
        return;
    }
    double below = fdh_levels[level - 1], share = (velocity - below) / (fdh_levels[level] - below);
    add(sent, fdh_rows + above[-1].first, fdh_rows + above->first, above->count, share);
}

/* Let a key go, but for its dampers. */
static void let_go(message *sent, const keyboard *keys, int n) { add_at(sent, fdh_keys[n].off, keys->velocity[n]); }

/* Let a key that is down go: its dampers come down, unless the pedal keeps them up. */
static void release_key(message *sent, keyboard *keys, int n) {
    let_go(sent, keys, n);
    if (!keys->pedal) add_rows(sent, fdh_keys[n].damp);
    keys->down[n] = 0;
    if (!keys->pedal) keys->pressed[n] = 0;
}

/* End the note of a key, whatever the pedal says: beside its dampers another one comes down for a while. */
static void end_key(message *sent, keyboard *keys, int n) {
    if (keys->down[n]) release_key(sent, keys, n);
    add_rows(sent, fdh_keys[n].steal);
    keys->pressed[n] = 0;
}

/* End the notes that cannot go on beside that of a key: its own, of its group, or one too many. */
static void make_room(message *sent, keyboard *keys, int pressed) {
    if (keys->down[pressed]) let_go(sent, keys, pressed);
    for (int n = 0; n < FDH_KEYS; n++)
        if (n != pressed && keys->down[n] && fdh_keys[n].group >= 0 && fdh_keys[n].group == fdh_keys[pressed].group)
            release_key(sent, keys, n);
    for (;;) {
        int count = 0, oldest = -1;
        for (int n = 0; n < FDH_KEYS; n++) {
            if (n == pressed || !keys->pressed[n]) continue;
            count++;
            int is_before = oldest < 0 || keys->down[n] < keys->down[oldest] ||
                            (keys->down[n] == keys->down[oldest] && keys->pressed[n] < keys->pressed[oldest]);
            if (is_before) oldest = n;
        }
        if (count < FDH_POLYPHONY) return;
        end_key(sent, keys, oldest);
    }
}

int fdh_note_on(fdh *patch, int number, int velocity) {
    int n = find_key(number);
    if (n < 0) return FDH_UNKNOWN;
    if (velocity < 1 || velocity > 127) return FDH_OUT_OF_RANGE;
    keyboard keys = patch->keyboard;
    message sent = begin_message(patch);
    make_room(&sent, &keys, n);
    keys.presses_of[n] = keys.down[n] ? keys.presses_of[n] + 1 : 1;
    keys.down[n] = 1;
    keys.pressed[n] = ++keys.presses;
    keys.velocity[n] = velocity;
    add_at(&sent, fdh_keys[n].on, velocity);
    int result = send(&sent);
    if (result == FDH_DONE) patch->keyboard = keys;
    return result;
}

int fdh_note_off(fdh *patch, int number) {
    int n = find_key(number);
    if (n < 0) return FDH_UNKNOWN;
    if (!patch->keyboard.down[n]) return FDH_DONE;
    keyboard keys = patch->keyboard;
    if (--keys.presses_of[n] > 0) {
        patch->keyboard = keys;
        return FDH_DONE;
    }
    message sent = begin_message(patch);
    release_key(&sent, &keys, n);
    int result = send(&sent);
    if (result == FDH_DONE) patch->keyboard = keys;
    return result;
}

int fdh_pedal(fdh *patch, int down) {
    keyboard *keys = &patch->keyboard;
    if (FDH_KEYS == 0) return FDH_UNKNOWN;
    if (!down == !keys->pedal) return FDH_DONE;
    message sent = begin_message(patch);
    for (int n = 0; n < FDH_KEYS; n++)
        if (!keys->down[n]) add_rows(&sent, down ? fdh_keys[n].lift : fdh_keys[n].damp);
    int result = send(&sent);
    if (result != FDH_DONE) return result;
    keys->pedal = down != 0;
    for (int n = 0; n < FDH_KEYS; n++)
        if (!down && !keys->down[n]) keys->pressed[n] = 0;
    return FDH_DONE;
}

int fdh_skip_score(fdh *patch) {
    if (FDH_KEYS == 0) return FDH_UNKNOWN;
    __atomic_store_n(&patch->skips_score, 1, __ATOMIC_RELAXED);
    return FDH_DONE;
}
