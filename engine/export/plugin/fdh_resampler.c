#include "fdh_resampler.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { CROSSINGS = 48, MAX_PHASES = 4096, RING = 16384, MAX_TAPS = 8192 };
static const double CUTOFF = 0.933, BETA = 10.06; /* of half the lower rate; Kaiser's window with -100 dB beside the pass band */

struct fdh_resampler {
    int from, to, channels, taps, phases;
    int64_t given, taken; /* frames */
    float *table, *ring; /* coefficients by phase; frames, of which the newest are kept */
};

static double bessel(double x) { /* modified, of order 0 */
    double sum = 1.0, term = 1.0;
    for (int k = 1; term > 1e-17 * sum; k++) term *= x / (2.0 * k) * (x / (2.0 * k)), sum += term;
    return sum;
}

static double window(double x) { return x * x < 1.0 ? bessel(BETA * sqrt(1.0 - x * x)) / bessel(BETA) : 0.0; }

static int greatest_divisor(int a, int b) { return b ? greatest_divisor(b, a % b) : a; }

static void fill_table(fdh_resampler *r, double cutoff) {
    int half = r->taps / 2;
    for (int phase = 0; phase < r->phases; phase++) {
        double sum = 0.0, at = (double)phase / r->phases;
        for (int k = 0; k < r->taps; k++) {
            double x = k - (half - 1) - at, y = M_PI * cutoff * x;
            double value = (y == 0.0 ? 1.0 : sin(y) / y) * cutoff * window(x / half);
            r->table[phase * r->taps + k] = (float)value;
            sum += value;
        }
        for (int k = 0; k < r->taps; k++) r->table[phase * r->taps + k] /= (float)sum; /* what is constant stays */
    }
}

fdh_resampler *fdh_make_resampler(int from, int to, int channels) {
    fdh_resampler *r = calloc(1, sizeof *r);
    if (!r) return NULL;
    int phases = to / greatest_divisor(from, to);
    double share = to < from ? (double)to / from : 1.0;
    r->from = from, r->to = to, r->channels = channels;
    r->taps = 2 * (int)ceil(CROSSINGS / share);
    r->taps = r->taps < MAX_TAPS ? r->taps : MAX_TAPS;
    r->phases = phases < MAX_PHASES ? phases : MAX_PHASES;
    r->table = malloc(sizeof(float) * (size_t)r->phases * r->taps);
    r->ring = malloc(sizeof(float) * RING * (size_t)channels);
    if (!r->table || !r->ring) return fdh_free_resampler(r), NULL;
    fill_table(r, CUTOFF * share);
    fdh_clear_resampler(r);
    return r;
}

void fdh_free_resampler(fdh_resampler *r) {
    if (!r) return;
    free(r->table), free(r->ring), free(r);
}

void fdh_clear_resampler(fdh_resampler *r) {
    memset(r->ring, 0, sizeof(float) * RING * (size_t)r->channels);
    r->given = r->taken = 0;
}

int fdh_delay(const fdh_resampler *r) { return (int)lround(r->taps / 2 * (double)r->to / r->from); }

/* The last frame before the place of the n-th that comes out; it lags by half the taps. */
static int64_t place_of(const fdh_resampler *r, int64_t n, int *phase) {
    int64_t whole = n * r->from / r->to, rest = n * r->from % r->to;
    *phase = (int)(rest * r->phases / r->to);
    return whole - r->taps / 2;
}

int fdh_needed_frames(const fdh_resampler *r, int frames) {
    int phase;
    int64_t last = place_of(r, r->taken + frames - 1, &phase) + r->taps / 2;
    return last >= r->given ? (int)(last + 1 - r->given) : 0;
}

void fdh_give(fdh_resampler *r, const float *in, int frames) {
    for (int i = 0; i < frames; i++, r->given++)
        memcpy(r->ring + r->given % RING * r->channels, in + i * r->channels, sizeof(float) * (size_t)r->channels);
}

void fdh_resample(fdh_resampler *r, float *out, int frames) {
    for (int i = 0; i < frames; i++, r->taken++) {
        int phase;
        int64_t first = place_of(r, r->taken, &phase) - (r->taps / 2 - 1);
        for (int c = 0; c < r->channels; c++) {
            double sum = 0.0;
            for (int k = 0; k < r->taps; k++) {
                int64_t at = first + k;
                if (at >= 0) sum += (double)r->table[phase * r->taps + k] * (double)r->ring[at % RING * r->channels + c];
            }
            out[i * r->channels + c] = (float)sum;
        }
    }
}

int fdh_is_silent(const fdh_resampler *r) {
    for (int64_t n = r->given > r->taps ? r->given - r->taps : 0; n < r->given; n++)
        for (int c = 0; c < r->channels; c++)
            if (fabsf(r->ring[n % RING * r->channels + c]) > 1e-7f) return 0;
    return 1;
}
