/* From one sample rate to another: windowed sinc, streaming. */
#ifndef FDH_RESAMPLER_H
#define FDH_RESAMPLER_H

typedef struct fdh_resampler fdh_resampler;
fdh_resampler *fdh_make_resampler(int from, int to, int channels); /* Hz; NULL: no memory */
void fdh_free_resampler(fdh_resampler *resampler);
void fdh_clear_resampler(fdh_resampler *resampler);
int fdh_delay(const fdh_resampler *resampler); /* frames that come out */
int fdh_needed_frames(const fdh_resampler *resampler, int frames); /* that must go in before so many come out */
void fdh_give(fdh_resampler *resampler, const float *in, int frames);
void fdh_resample(fdh_resampler *resampler, float *out, int frames);
int fdh_is_silent(const fdh_resampler *resampler);
#endif
