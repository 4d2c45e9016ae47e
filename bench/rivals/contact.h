/* One contact without loss, f(s) = kc [s]+^ALPHA: where a step that would move the compression from s by g ends.

   The file that includes this defines ALPHA, power(x) = x^ALPHA, root(x) = x^(1/ALPHA), far_root(x) =
   x^(1/(ALPHA+1)), and span(a, b) = (b^(ALPHA+1) - a^(ALPHA+1))/(b - a) without cancellation; and CLOSED and
   closed() for an exponent that needs no iteration. Neither the step nor the end is formed from the other. */

#include <math.h>

#define N (ALPHA + 1.0)

typedef struct {
    double eta, b, f; /* step and end, m; force in units of kc/(ALPHA+1) */
} End;

#ifdef CLOSED
static inline End closed(double s, double g, double scale);
#endif

/* Begins in contact and ends outside it: the whole energy is given back, s^(ALPHA+1) of it. */
static inline End separate(double s, double g, double elastic)
{
    double width = sqrt(g * g + 4.0 * elastic), total = 2.0 * s + g;
    double eta = g < 0.0 ? 0.5 * (g - width) : -2.0 * elastic / (g + width);
    double b = total <= 0.0 ? 0.5 * (total - width) : 2.0 * (s * (s + g) - elastic) / (total + width);
    return (End){eta, b, s * power(s) / -eta};
}

/* The asymptotes of the solution. scale: B kc/(ALPHA+1) */
static inline double first_guess(double s, double g, double scale)
{
    double big = s + g;
    if (s <= 0.0) { /* enters: one Halley step on the equation without its quotient */
        double free = big / scale, near = root(free), far = far_root(-s * free);
        double b = near >= far ? near : far, whole = near >= far ? big * near : -s * big;
        if (b >= big)
            return big;
        double miss = whole - (big - b) * (b - s), tilt = N * whole / b - (big + s - 2.0 * b);
        double bottom = 2.0 * tilt * tilt - miss * (N * ALPHA * whole / (b * b) + 2.0);
        double step = bottom > 0.0 ? -2.0 * miss * tilt / bottom : -miss / tilt;
        return fmin(big, fmax(b + step, 0.5 * b));
    }
    double kappa = N * scale * power(s) / s, away = (g / s - kappa) / (1.0 + 0.5 * ALPHA * kappa), t = big / s;
    if (fabs(away) * ALPHA < 0.5)
        return s + s * away;
    if (away > 0.0) { /* loads */
        double q = root(t / kappa);
        return fmin(big, s * fmin(fmin(t, 1.0 + away), fmin(2.0 * q - 1.0, root(N) * q)));
    }
    double over = N * t - kappa, mid = N + ALPHA * t; /* unloads */
    return s * 2.0 * over / (mid + sqrt(fmax(0.0, mid * mid - 4.0 * ALPHA * over)));
}

/* Discrete gradient and its first three derivatives by the end b > 0. */
static inline void gradient(double s, double b, double eta, double d[4])
{
    double e = eta / b, end = N * power(b), one = ALPHA * end / b, two = (ALPHA - 1.0) * one / b;
    d[0] = s <= 0.0 ? power(b) * (b / eta) : span(s, b);
    if (fabs(e) < 1e-3) {
        double c = (ALPHA - 2.0) * e, g = (ALPHA - 3.0) * e;
        d[1] = one * (0.5 - (ALPHA - 1.0) * e * (1.0 / 6.0 - c * (1.0 / 24.0 - g / 120.0)));
        d[2] = two * (1.0 / 3.0 - c * (1.0 / 12.0 - g / 60.0));
        d[3] = two * (ALPHA - 2.0) / b * 0.25;
    } else {
        double over = 1.0 / eta;
        d[1] = (end - d[0]) * over;
        d[2] = (one - 2.0 * d[1]) * over;
        d[3] = (two - 3.0 * d[2]) * over;
    }
}

/* Halley's iteration in a bracket; the force is extrapolated over the last step. */
static inline End iterate(double s, double g, double scale, double b)
{
    double big = s + g, eta = b - s, low = 0.0, high = big, d[4];
    if (s > 0.0) {
        if (g > scale * N * power(s))
            low = s;
        else
            high = s;
    }
    for (int count = 0; count < 60; count++) {
        gradient(s, b, eta, d);
        double push = scale * d[0], slope = 1.0 + scale * d[1];
        double miss = fabs(eta) < b ? (eta - g) + push : (b - big) + push;
        double bottom = 2.0 * slope * slope - miss * scale * d[2];
        double step = bottom > 0.0 ? -2.0 * miss * slope / bottom : -miss / slope;
        if (miss > 0.0)
            high = fmin(high, b);
        else
            low = fmax(low, b);
        int trusted = low <= b + step && b + step <= high;
        if (!trusted) {
            step = -miss / slope;
            trusted = low * (1.0 - 1e-15) <= b + step && b + step <= high * (1.0 + 1e-15);
            if (!trusted)
                step = 0.5 * (low + high) - b;
        }
        double size = N * fabs(step) / fmax(s, fmin(b, b + step)), change = fabs(step) * (slope - 1.0);
        double error = fmax(size * size * (slope - 1.0) / slope, size * size * size) * change;
        double after = push + step * (slope - 1.0);
        int done = (trusted && error <= 1e-15 * after && push <= 8.0 * after)
                   || fabs(miss) <= 4.4e-16 * (push + fmin(fabs(g), fabs(big)));
        b += step;
        eta += step;
        if (done)
            return (End){eta, b, d[0] + step * (d[1] + step * (0.5 * d[2] + step * d[3] / 6.0))};
    }
    return (End){eta, b, d[0]};
}

/* What rounding leaves of a step has the same sign throughout a contact: it is carried to the next one. */
static inline double collide(double *s, double *residue, double g, double compliance, double unit)
{
    double from = *s, scale = compliance * unit, elastic = scale * from * power(from);
    End end;
    if (from > 0.0 && from * (from + g) <= elastic)
        end = separate(from, g, elastic);
#ifdef CLOSED
    else if (from > 0.0)
        end = closed(from, g, scale);
#endif
    else
        end = iterate(from, g, scale, first_guess(from, g, scale));
    double left = *residue + ((g - end.eta) - scale * end.f);
    if (2.0 * fabs(end.eta) < end.b) {
        *s = from + (end.eta + left);
        *residue = (end.eta + left) - (*s - from);
    } else {
        *s = end.b;
        *residue = left;
    }
    return unit * end.f;
}
