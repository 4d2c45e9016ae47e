/* Free modes with loss, all of which are heard. MODES is padded, so that no loop has a remainder. */

long modes; /* MODES is a number, or this */

void run(long frames, const double *restrict tables, double *restrict state, double *restrict out)
{
    const double *restrict pull = tables, *restrict drift = pull + MODES, *restrict keep = drift + MODES;
    const double *restrict ear = keep + MODES;
    double *restrict q = state, *restrict p = q + MODES;
    for (long i = 0; i < frames; i++) {
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
}
