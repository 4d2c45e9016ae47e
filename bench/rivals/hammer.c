/* A felt hammer, the last mode, on the modes of a string; MODES is padded, so that no loop has a remainder.

   Between two contact forces each mode is passed once: the end of a step and the beginning of the next. */

#define ALPHA 2.5

#include <math.h>

static inline double power(double x) { return x * x * sqrt(x); }
static inline double root(double x) { return pow(x, 0.4); }
static inline double far_root(double x) { return pow(x, 1.0 / 3.5); }

static inline double span(double a, double b)
{
    double u = sqrt(a), v = sqrt(b), a2 = a * a, b2 = b * b;
    return (a2 * a + b2 * b + u * v * (a2 + b2 + a * b) + a * b * (a + b)) / (u + v);
}

#include "contact.h"

#define PIECE 64

long modes; /* MODES is a number, or this */

/* tables, rows of MODES: pull, drift, keep, kick row, drift row, ear, shape, stiffness, and room: how far each mode
   can move the contact in a PIECE per unit of its speed; then barrier, compliance, unit. frames: a multiple of PIECE */
void run(long frames, const double *restrict tables, double *restrict state, double *restrict out)
{
    const double *restrict pull = tables, *restrict drift = pull + MODES, *restrict keep = drift + MODES;
    const double *restrict kick = keep + MODES, *restrict move = kick + MODES, *restrict ear = move + MODES;
    const double *restrict shape = ear + MODES, *restrict stiffness = shape + MODES, *restrict room = stiffness + MODES;
    double barrier = room[MODES], compliance = room[MODES + 1], unit = room[MODES + 2];
    double *restrict q = state, *restrict p = q + MODES, *contact = p + MODES;
    double s = contact[0], residue = contact[1];
    for (long begin = 0; begin < frames; begin += PIECE) {
        double place = -barrier, far = 0.0;
#pragma omp simd reduction(+ : place, far)
        for (long m = 0; m < MODES; m++) {
            place += shape[m] * q[m];
            far += room[m] * sqrt(p[m] * p[m] + stiffness[m] * q[m] * q[m]);
        }
        if (s <= 0.0)
            s = fmin(place, 0.0);
        if (s + 1.01 * far < 0.0) { /* nothing can touch in this piece */
            for (long i = begin; i < begin + PIECE; i++) {
                double heard = 0.0;
#pragma omp simd reduction(+ : heard) aligned(pull, drift, keep, ear, q, p : 64)
                for (long m = 0; m < MODES; m++) {
                    heard += ear[m] * p[m];
                    double half = keep[m] * p[m] - pull[m] * q[m];
                    q[m] += drift[m] * half;
                    p[m] = keep[m] * (half - pull[m] * q[m]);
                }
                out[i] = heard;
            }
            continue;
        }
        for (long i = begin; i < begin + PIECE; i++) {
            double heard = 0.0, g = 0.0;
#pragma omp simd reduction(+ : heard, g) aligned(pull, keep, ear, move, q, p : 64)
            for (long m = 0; m < MODES; m++) {
                heard += ear[m] * p[m];
                p[m] = keep[m] * p[m] - pull[m] * q[m];
                g += move[m] * p[m];
            }
            out[i] = heard;
            double f = 0.0;
            if (s > 0.0 || s + g > 0.0)
                f = collide(&s, &residue, g, compliance, unit);
            else
                s += g;
#pragma omp simd aligned(pull, drift, keep, kick, q, p : 64)
            for (long m = 0; m < MODES; m++) {
                double push = kick[m] * f, half = p[m] - push;
                q[m] += drift[m] * half;
                p[m] = keep[m] * (half - pull[m] * q[m] - push);
            }
        }
    }
    contact[0] = s, contact[1] = residue;
}
