"""Oversampled audio decimated to the requested sample rate."""

import numpy as np

HALF_LENGTH = 140  # samples of the output to either side that the filter takes …
KAISER_BETA = 20.5  # … and the β of its window: 190 dB


def decimation_tail(oversample: int) -> int:
    """Return the number of samples beyond the end that a decimation filter needs."""
    return HALF_LENGTH * oversample if oversample > 1 else 0


def decimate(audio: np.ndarray, oversample: int, frames: int) -> np.ndarray:
    """Every so many samples of what a linear-phase filter leaves: all to 0.9 of the Nyquist frequency, to 1e-9, and
    nothing that would alias below that. audio: frames·oversample samples, and `decimation_tail` more."""
    from scipy.signal import firwin, upfirdn

    taps = firwin(2 * HALF_LENGTH * oversample + 1, 1.0 / oversample, window=("kaiser", KAISER_BETA))
    return np.asarray(upfirdn(taps, audio, 1, oversample, axis=0)[HALF_LENGTH : HALF_LENGTH + frames])


def resample(audio: np.ndarray, fine: int, samplerate: int, frames: int) -> np.ndarray:
    """Audio at a rate `fine` (Hz), at another rate."""
    import soxr

    coarse = np.zeros((frames, audio.shape[1]))
    resampled = soxr.resample(audio, fine, samplerate, quality="VHQ")[:frames]
    coarse[: len(resampled)] = resampled
    return coarse
