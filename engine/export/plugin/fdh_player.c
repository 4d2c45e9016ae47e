#include "fdh_player.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fdh_kernels.h"
#include "fdh_resampler.h"

enum { ALIGNMENT = 64, AT_ONCE = 512 };
static const int64_t IS_SHARED = (int64_t)1 << 62;

struct fdh_player {
    fdh_file *file;
    const fdh_rate *at;
    const fdh_kernels *kernels;
    fdh_resampler *resampler;
    unsigned char *memory, *private_bytes;
    float *waiting; /* frames for the resampler */
    double *values; /* of controls */
    int pedals[FDH_PEDALS], sought[FDH_PEDALS]; /* as they are, and as they are to be when there is room */
    char down[FDH_MAX_KEYS], kept[FDH_MAX_KEYS], ended[FDH_MAX_KEYS];
    int presses[FDH_MAX_KEYS];              /* how often a key that is down was pressed: it is held as often */
    enum { NOTHING, RELEASE, CHOKE } owed[FDH_MAX_KEYS]; /* what found no room yet */
    int owes;
    double velocity[FDH_MAX_KEYS];          /* with which a key was pressed last */
    int64_t sounding[FDH_MAX_KEYS], count;  /* order of those whose dampers have not ended them; 0: rests */
    int64_t lost, end;                      /* end of the queue with what is being written */
};

/* --- memory */

static void relocate(fdh_player *p) {
    memcpy(p->private_bytes, p->at->private_bytes, (size_t)p->at->private_size);
    for (int64_t n = 0; n < p->at->pointer_count; n++) {
        int64_t *pointer = (int64_t *)(void *)(p->private_bytes + p->at->pointers[n]);
        *pointer = *pointer & IS_SHARED ? (*pointer & ~IS_SHARED) + (intptr_t)p->at->shared : *pointer + (intptr_t)p->private_bytes;
    }
    const int64_t *n = p->at->numbers;
    int has_stages = n[FDH_RATE_HAS_STAGES] != 0;
    *(int64_t *)(void *)(p->private_bytes + n[FDH_RATE_RENDER_AT]) = (intptr_t)p->kernels->render[has_stages];
    *(int64_t *)(void *)(p->private_bytes + n[FDH_RATE_INSERT_AT]) = (intptr_t)p->kernels->insert[has_stages];
    ((double *)(void *)(p->private_bytes + n[FDH_RATE_GAUGES]))[FDH_GAIN] = p->file->gain;
}

void fdh_reset(fdh_player *p) {
    relocate(p);
    memset(p->pedals, 0, sizeof p->pedals), memset(p->sought, 0, sizeof p->sought);
    memset(p->down, 0, sizeof p->down), memset(p->kept, 0, sizeof p->kept), memset(p->ended, 0, sizeof p->ended);
    memset(p->presses, 0, sizeof p->presses), memset(p->owed, 0, sizeof p->owed);
    memset(p->sounding, 0, sizeof p->sounding);
    p->count = p->lost = 0, p->owes = 0;
    for (int n = 0; n < p->file->controls; n++) p->values[n] = p->at->controls[n].home;
    if (p->resampler) fdh_clear_resampler(p->resampler);
}

static int nearest_rate(const fdh_file *file, double rate) {
    int nearest = 0;
    for (int n = 1; n < file->rate_count; n++)
        if (fabs(log(file->rates[n] / rate)) < fabs(log(file->rates[nearest] / rate))) nearest = n;
    return nearest;
}

fdh_player *fdh_create(fdh_file *file, double rate, char *fault) {
    fdh_player *p = file->fault[0] ? NULL : calloc(1, sizeof *p);
    snprintf(fault, FDH_FAULT, "%s", file->fault[0] ? file->fault : "there is no memory");
    if (!p) return NULL;
    p->file = file;
    if ((p->kernels = fdh_find_kernels()) == NULL) {
        snprintf(fault, FDH_FAULT, "this processor is too old: the kernels need AVX2 and multiply-add (made since 2013)");
        return free(p), NULL;
    }
    p->at = rate >= 1000.0 && rate <= 1e6 ? fdh_take_rate(file, nearest_rate(file, rate)) : NULL;
    if (!p->at) {
        if (file->fault[0]) snprintf(fault, FDH_FAULT, "%s", file->fault);
        return free(p), NULL;
    }
    int is_resampled = lround(rate) != p->at->rate;
    p->memory = malloc((size_t)p->at->private_size + 2 * ALIGNMENT);
    p->values = calloc((size_t)file->controls + 1, sizeof *p->values);
    p->waiting = calloc((size_t)AT_ONCE * file->channels, sizeof *p->waiting);
    if (is_resampled) p->resampler = fdh_make_resampler(p->at->rate, (int)lround(rate), file->channels);
    if (!p->memory || !p->values || !p->waiting || (is_resampled && !p->resampler)) {
        fdh_destroy(p);
        return NULL;
    }
    p->private_bytes = p->memory + (ALIGNMENT - (uintptr_t)p->memory % ALIGNMENT) % ALIGNMENT;
    fdh_reset(p);
    fault[0] = 0;
    return p;
}

void fdh_destroy(fdh_player *p) {
    if (!p) return;
    fdh_release_rate(p->file, p->at);
    fdh_free_resampler(p->resampler);
    free(p->memory), free(p->values), free(p->waiting), free(p);
}

/* --- sound */

static int64_t *counter(const fdh_player *p, int slot) {
    return (int64_t *)(void *)(p->private_bytes + p->at->numbers[FDH_RATE_COUNTERS]) + slot;
}

static void pay(fdh_player *p);

static void play(fdh_player *p, float *out, int frames) {
    if (p->owes) pay(p);
    p->kernels->play(p->private_bytes + p->at->numbers[FDH_RATE_MEMORY], (intptr_t)out, frames);
}

void fdh_process(fdh_player *p, float *out, int frames) {
    while (frames > 0) {
        int count = frames < AT_ONCE ? frames : AT_ONCE, needed;
        if (p->resampler) {
            while ((needed = fdh_needed_frames(p->resampler, count)) > 0) {
                needed = needed < AT_ONCE ? needed : AT_ONCE;
                play(p, p->waiting, needed);
                fdh_give(p->resampler, p->waiting, needed);
            }
            fdh_resample(p->resampler, out, count);
        } else {
            play(p, out, count);
        }
        out += count * p->file->channels, frames -= count;
    }
}

int fdh_latency(const fdh_player *p) { return p->resampler ? fdh_delay(p->resampler) : 0; }

static int sleeps(const fdh_player *p, int64_t island) {
    const int64_t *n = p->at->numbers, *sleep = (const int64_t *)(const void *)(p->private_bytes + n[FDH_RATE_SLEEP]);
    return sleep[island * n[FDH_RATE_REST] + FDH_WAKE_FRAME] > *counter(p, FDH_FRAME);
}

int fdh_is_asleep(const fdh_player *p) {
    if (p->owes || *counter(p, FDH_WAITING) || *counter(p, FDH_WRITE_INDEX) != *counter(p, FDH_READ_INDEX)) return 0;
    for (int64_t n = 0; n < p->at->numbers[FDH_RATE_ISLANDS]; n++)
        if (!sleeps(p, n)) return 0;
    return p->resampler ? fdh_is_silent(p->resampler) : 1;
}

int64_t fdh_lost(const fdh_player *p) { return p->lost + *counter(p, FDH_DROPPED); }

double fdh_energy_error(const fdh_player *p) {
    const double *balance = (const double *)(const void *)(p->private_bytes + p->at->numbers[FDH_RATE_BALANCE]);
    return balance[FDH_LARGEST] > 0.0 ? balance[FDH_MAX_ERROR] / balance[FDH_LARGEST] : 0.0;
}

/* --- events: rows are written to the queue of the kernels, all of a message or none */

static int64_t waiting_rows(const fdh_player *p) { return p->end - *counter(p, FDH_READ_INDEX); }

static void begin(fdh_player *p) {
    if (*counter(p, FDH_WRITE_INDEX) - *counter(p, FDH_READ_INDEX) > FDH_QUEUE / 2)
        p->kernels->take(p->private_bytes + p->at->numbers[FDH_RATE_MEMORY]); /* they wait for their frame elsewhere */
    p->end = *counter(p, FDH_WRITE_INDEX);
}

static void write_row(fdh_player *p, const fdh_row *row, const double *values) {
    if (waiting_rows(p) < FDH_QUEUE) { /* else the message is refused as a whole */
        int64_t slot = p->end % FDH_QUEUE, frame = *counter(p, FDH_FRAME);
        int64_t *event = (int64_t *)(void *)(p->private_bytes + p->at->numbers[FDH_RATE_EVENTS]) + FDH_EVENT * slot;
        memset(event, 0, sizeof(int64_t) * FDH_EVENT);
        memcpy(event, row->number, sizeof row->number);
        if (event[FDH_START] > 0) event[FDH_START] += frame;
        if (row->table >= 0) event[FDH_TABLE_AT] = row->table + (intptr_t)p->private_bytes;
        memcpy(p->private_bytes + p->at->numbers[FDH_RATE_VALUES] + (int64_t)sizeof(double) * FDH_VALUES * slot, values,
               sizeof(double) * FDH_VALUES);
    }
    p->end++;
}

/* Add rows, with values between two of them: a share of 0 is the first. */
static void add(fdh_player *p, const fdh_row *from, const fdh_row *to, int64_t count, double share) {
    for (int64_t i = 0; i < count; i++) {
        double values[FDH_VALUES];
        for (int k = 0; k < FDH_VALUES; k++) {
            double step = to[i].value[k] - from[i].value[k];
            values[k] = step == 0.0 ? from[i].value[k] : from[i].value[k] + share * step;
        }
        write_row(p, from[i].table >= 0 && share >= 0.5 ? to + i : from + i, values);
    }
}

static void add_rows(fdh_player *p, fdh_rows rows) { add(p, p->at->rows + rows.first, p->at->rows + rows.first, rows.count, 0.0); }

static int send(fdh_player *p) {
    if (waiting_rows(p) > FDH_QUEUE) return -1;
    *counter(p, FDH_WRITE_INDEX) = p->end;
    return 0;
}

/* --- keys, as live sound has them (engine.instrument.key_sequencer) */

int fdh_find_key(const fdh_file *file, int number) {
    for (int n = 0; n < file->keys; n++)
        if (file->about_keys[n].number == number) return n;
    return -1;
}

static int is_down(const fdh_player *p, int pedal) { return p->pedals[pedal] >= p->file->pedal_down; }

/* Add rows of a key at a velocity, of which there are those of a few. */
static void add_at(fdh_player *p, const fdh_rows *of_levels, double velocity) {
    const int64_t *levels = p->file->levels;
    int level = 0;
    while ((double)levels[level] < velocity) level++;
    const fdh_rows *above = of_levels + level;
    if ((double)levels[level] == velocity) return add_rows(p, *above);
    double share = (velocity - (double)levels[level - 1]) / (double)(levels[level] - levels[level - 1]);
    if (above[-1].count != above->count) return add_rows(p, share < 0.5 ? above[-1] : *above);
    add(p, p->at->rows + above[-1].first, p->at->rows + above->first, above->count, share);
}

static void let_go(fdh_player *p, int n) {
    const fdh_key *key = p->at->keys + n;
    add_at(p, is_down(p, FDH_SOFT) ? key->soft_off : key->off, p->velocity[n] >= 1.0 ? p->velocity[n] : 64.0);
}

/* Put the dampers of a key down as far as the pedals let them. */
static void damp(fdh_player *p, int n) {
    int64_t share = p->down[n] || p->kept[n] ? 0 : p->file->shares[p->pedals[FDH_SUSTAIN]];
    if (!share) return;
    p->sounding[n] = 0;
    add_rows(p, p->at->keys[n].damp[share - 1]);
}

typedef struct { /* what a message changes, so that one that finds no room changes nothing */
    char down[FDH_MAX_KEYS], kept[FDH_MAX_KEYS], ended[FDH_MAX_KEYS];
    int64_t sounding[FDH_MAX_KEYS];
} before;

static before begin_message(fdh_player *p) {
    before kept;
    memcpy(kept.down, p->down, sizeof p->down), memcpy(kept.kept, p->kept, sizeof p->kept);
    memcpy(kept.ended, p->ended, sizeof p->ended), memcpy(kept.sounding, p->sounding, sizeof p->sounding);
    begin(p);
    return kept;
}

static int end_message(fdh_player *p, const before *kept) {
    if (send(p) == 0) return 0;
    memcpy(p->down, kept->down, sizeof p->down), memcpy(p->kept, kept->kept, sizeof p->kept);
    memcpy(p->ended, kept->ended, sizeof p->ended), memcpy(p->sounding, kept->sounding, sizeof p->sounding);
    return -1;
}

static void release(fdh_player *p, int n) {
    let_go(p, n);
    p->down[n] = 0, p->ended[n] = 1;
    damp(p, n);
}

/* End a key, as it cannot go on beside another. Of two dampers the newer counts, and the other goes on. */
static void end(fdh_player *p, int n, fdh_rows at_last) {
    if (p->down[n]) let_go(p, n);
    p->down[n] = p->kept[n] = 0, p->ended[n] = 1;
    p->sounding[n] = 0;
    damp(p, n);
    add_rows(p, at_last);
}

static void make_room(fdh_player *p, int pressed) {
    const fdh_key *keys = p->at->keys;
    for (int n = 0; n < p->file->keys; n++)
        if (n != pressed && p->down[n] && keys[n].group >= 0 && keys[n].group == keys[pressed].group) release(p, n);
    while (p->file->polyphony) {
        int count = 0, oldest = -1;
        for (int n = 0; n < p->file->keys; n++) {
            if (n == pressed || !p->sounding[n]) continue;
            count++;
            int is_before = oldest < 0 || p->down[n] < p->down[oldest] ||
                            (p->down[n] == p->down[oldest] && p->sounding[n] < p->sounding[oldest]);
            if (is_before) oldest = n;
        }
        if (count < p->file->polyphony) return;
        end(p, oldest, keys[oldest].steal);
    }
}

int fdh_note_on(fdh_player *p, int n, double velocity) {
    if (n < 0 || n >= p->file->keys || !(velocity > 0.0)) return 0;
    const fdh_key *key = p->at->keys + n;
    velocity = velocity < 1.0 ? 1.0 : velocity > 127.0 ? 127.0 : velocity;
    if (p->owed[n]) pay(p);
    before kept = begin_message(p);
    if (p->down[n]) let_go(p, n);
    make_room(p, n);
    add_at(p, is_down(p, FDH_SOFT) ? key->soft_on : key->on, velocity);
    if (end_message(p, &kept)) return p->lost++, -1;
    p->presses[n] = p->down[n] ? p->presses[n] + 1 : 1;
    p->down[n] = 1, p->ended[n] = 0, p->velocity[n] = velocity;
    p->sounding[n] = ++p->count;
    return 0;
}

static int try_release(fdh_player *p, int n) {
    before kept = begin_message(p);
    release(p, n);
    return end_message(p, &kept);
}

static int try_choke(fdh_player *p, int n) {
    before kept = begin_message(p);
    end(p, n, p->at->keys[n].choke);
    return end_message(p, &kept);
}

static void owe(fdh_player *p, int n, int what) { p->owed[n] = what, p->owes = 1; }

void fdh_note_off(fdh_player *p, int n) {
    if (n < 0 || n >= p->file->keys || !p->down[n] || --p->presses[n] > 0) return;
    if (try_release(p, n)) owe(p, n, RELEASE);
}

void fdh_choke(fdh_player *p, int n) {
    if (n >= 0 && n < p->file->keys && try_choke(p, n)) owe(p, n, CHOKE);
}

void fdh_silence(fdh_player *p) {
    for (int n = 0; n < p->file->keys; n++) fdh_choke(p, n); /* what others have set ringing ends, too */
}

void fdh_release_all(fdh_player *p) {
    for (int n = 0; n < p->file->keys; n++) {
        if (p->down[n]) p->presses[n] = 1;
        fdh_note_off(p, n);
    }
}

static int try_pedal(fdh_player *p, int pedal, int value) {
    int was = is_down(p, pedal), value_before = p->pedals[pedal];
    int64_t share = p->file->shares[p->pedals[FDH_SUSTAIN]];
    char moved[FDH_MAX_KEYS] = {0};
    before kept = begin_message(p);
    p->pedals[pedal] = value;
    if (pedal == FDH_SUSTAIN && share != p->file->shares[value]) memset(moved, 1, sizeof moved);
    if (pedal == FDH_SOSTENUTO && was != is_down(p, pedal)) {
        memcpy(moved, p->kept, sizeof moved);
        if (was) memset(p->kept, 0, sizeof p->kept);
        else memcpy(p->kept, p->down, sizeof p->kept);
    }
    for (int n = 0; n < p->file->keys; n++) {
        if (!moved[n] || p->down[n] || p->kept[n]) continue;
        if (p->file->shares[p->pedals[FDH_SUSTAIN]]) damp(p, n);
        else add_rows(p, p->at->keys[n].lift);
    }
    if (end_message(p, &kept) == 0) return 0;
    p->pedals[pedal] = value_before;
    return -1;
}

void fdh_pedal(fdh_player *p, int pedal, int value) {
    p->sought[pedal] = value < 0 ? 0 : value > 127 ? 127 : value;
    if (try_pedal(p, pedal, p->sought[pedal])) p->owes = 1;
}

/* Do what had found no room: no release is lost. */
static void pay(fdh_player *p) {
    p->owes = 0;
    for (int k = 0; k < FDH_PEDALS; k++)
        if (p->pedals[k] != p->sought[k] && try_pedal(p, k, p->sought[k])) p->owes = 1;
    for (int n = 0; n < p->file->keys; n++) {
        int what = p->owed[n];
        p->owed[n] = NOTHING;
        if (what && (what == RELEASE ? try_release(p, n) : try_choke(p, n))) owe(p, n, what);
    }
}

int fdh_note_ended(fdh_player *p, int n) {
    if (!p->ended[n] || p->owed[n] || *counter(p, FDH_WAITING) || *counter(p, FDH_WRITE_INDEX) != *counter(p, FDH_READ_INDEX))
        return 0;
    const fdh_rows *on = p->at->keys[n].on + FDH_LEVELS - 1;
    for (int64_t i = on->first; i < on->first + on->count; i++)
        if (!sleeps(p, p->at->rows[i].number[1])) return 0;
    p->ended[n] = 0;
    return 1;
}

/* --- controls */

/* The value of the rows of a slider, with the roundings of live sound. */
static double value_of_rows(const fdh_control *c, double value) {
    if (c->compliance == 0.0) return (value - c->shift) / c->part / c->unit;
    volatile double share = value * c->compliance; /* no compiler fuses it with what follows */
    return value / (1.0 - (share < c->most ? share : c->most));
}

static int64_t position_of(const fdh_rate *at, const fdh_control *c, double value) {
    const double *positions = at->positions + c->first_position;
    int64_t nearest = 0;
    for (int64_t n = 1; n < c->count; n++) { /* the nearest in ratio, or in cents */
        double a = positions[n], b = positions[nearest];
        double nearer = c->is_logarithmic ? fabs(log(a / value)) - fabs(log(b / value)) : fabs(a - value) - fabs(b - value);
        if (nearer < 0.0) nearest = n;
    }
    return nearest;
}

static void go_to(fdh_player *p, int n, double value) {
    const fdh_control *c = p->at->controls + n;
    add_rows(p, (fdh_rows){c->first + position_of(p->at, c, value), 1});
}

void fdh_set(fdh_player *p, int n, double value) {
    if (n < 0 || n >= p->file->controls || !(value == value)) return;
    const fdh_control *c = p->at->controls + n;
    value = value < c->low ? c->low : value > c->high ? c->high : value;
    double was = p->values[n];
    if (value == was) return;
    begin(p);
    if (c->kind == FDH_SLIDER) {
        for (int64_t i = 0; i < c->count; i++) {
            const fdh_row *row = p->at->rows + c->first + i;
            double values[FDH_VALUES];
            memcpy(values, row->value, sizeof values);
            values[0] = value_of_rows(c, value);
            write_row(p, row, values);
        }
    } else if (position_of(p->at, c, value) != position_of(p->at, c, was)) {
        for (int m = 0; m < p->file->controls && m < 63; m++) /* tables are made for one away from home at a time */
            if (c->overlapping >> m & 1 && p->values[m] != p->at->controls[m].home) {
                go_to(p, m, p->at->controls[m].home);
                p->values[m] = p->at->controls[m].home;
            }
        go_to(p, n, value);
    }
    if (send(p)) p->lost++;
    else p->values[n] = value;
}

double fdh_value(const fdh_player *p, int control) { return p->values[control]; }

void fdh_bend(fdh_player *p, double share) {
    for (int n = 0; n < p->file->controls; n++) {
        const fdh_control *c = p->at->controls + n;
        if (c->kind == FDH_WHEEL) fdh_set(p, n, share < 0.0 ? -share * c->low : share * c->high);
    }
}
