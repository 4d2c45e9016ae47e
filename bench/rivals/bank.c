/* Free modes with loss; the last is a free mass, which is heard. MODES is padded, so that no loop has a remainder. */

long modes; /* MODES is a number, or this */

void run(long frames, const double *restrict tables, double *restrict state, double *restrict out)
{
    const double *restrict pull = tables, *restrict drift = pull + MODES, *restrict keep = drift + MODES;
    double *restrict q = state, *restrict p = q + MODES;
    for (long i = 0; i < frames; i++) {
        out[i] = p[HEARD];
#pragma omp simd aligned(pull, drift, keep, q, p : 64)
        for (long m = 0; m < MODES; m++) {
            double half = keep[m] * p[m] - pull[m] * q[m];
            q[m] += drift[m] * half;
            p[m] = keep[m] * (half - pull[m] * q[m]);
        }
    }
}
