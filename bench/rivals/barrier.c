/* An oscillator without loss against a barrier with f(s) = kc [s]+^2. */

#define ALPHA 2.0
#define CLOSED

#include <math.h>

static inline double power(double x) { return x * x; }
static inline double root(double x) { return sqrt(x); }
static inline double far_root(double x) { return cbrt(x); }
static inline double span(double a, double b) { return a * a + b * (a + b); }

#include "contact.h"

/* Ends in contact: the equation is quadratic. */
static inline End closed(double s, double g, double scale)
{
    double over = (s + g) - scale * s * s, c = 1.0 + scale * s, width = sqrt(c * c + 4.0 * scale * over);
    double b = 2.0 * over / (c + width);
    return (End){2.0 * (g - 3.0 * scale * s * s) / (c + 2.0 * scale * s + width), b, span(s, b)};
}

long modes; /* MODES, which is 1 */

/* tables: pull, drift, shape, kick row, drift row, ear; then barrier, compliance, unit. frames: a multiple of 64 */
void run(long frames, const double *restrict tables, double *restrict state, double *restrict out)
{
    double pull = tables[0], drift = tables[1], shape = tables[2], kick = tables[3], move = tables[4], ear = tables[5];
    double barrier = tables[6], compliance = tables[7], unit = tables[8];
    double q = state[0], p = state[1], s = state[2], residue = state[3];
    for (long i = 0; i < frames; i++) {
        if (i % 64 == 0 && s <= 0.0)
            s = fmin(shape * q - barrier, 0.0);
        out[i] = ear * p;
        p -= pull * q;
        double g = move * p;
        if (s > 0.0 || s + g > 0.0) {
            double push = kick * collide(&s, &residue, g, compliance, unit);
            p -= push;
            q += drift * p;
            p -= pull * q + push;
        } else {
            s += g;
            q += drift * p;
            p -= pull * q;
        }
    }
    state[0] = q, state[1] = p, state[2] = s, state[3] = residue;
}
