"""What a sound is like, in a few numbers: how loud, how high, how long, how bright. For tables of many sounds."""

import math

import numpy as np

from engine.measures import vertex
from engine.save import SILENCE

LOWEST = 20.0  # Hz, below which nothing is a pitch: bounces, drift
QUIET = 20.0  # dB below the strongest partial, down to which a lower one is the fundamental
CLEAR = 10.0  # dB by which a partial stands out of its valleys
TONAL = 25.0  # dB of the strongest partial over the median of the spectrum; noise reaches 14
FIT = (-5.0, -25.0)  # dB, between which the decay is measured
STRAIGHT = 1.5  # by how much the slope of that line may differ from that between its ends: blows are no decay
TAIL = 0.25  # of the time of that fall, for which the sound must go on, or its end bends the curve
LONGEST = 2**21  # frames of which a spectrum is taken

FEATURES = ("peak", "rms", "silent", "fundamental_hz", "strongest_hz", "centroid_hz", "t60_s")


def features(audio: np.ndarray, samplerate: float) -> dict[str, float | None]:
    """Measured features of a sound; None where one is not defined, never NaN.

    audio: float64 [frames, channels]; all channels count together, but none cancels another

    peak, rms:      in the unit of the audio (SI, if it is not normalised)
    silent:         1 if nothing is to be heard, else 0
    fundamental_hz: the lowest partial within 20 dB of the strongest, from 20 Hz up; the true one is missed
                    where it is weaker than that. None for noise and clicks, in which no partial stands out
    strongest_hz:   the strongest partial
    centroid_hz:    mean frequency, weighted by power; without what does not change
    t60_s:          time to fall by 60 dB, from a line through -5 to -25 dB of the energy that is still to come
                    (Schroeder); None where the sound does not fall so far, or ends in the midst of it

    All are None if a sample is not finite.
    """
    found: dict[str, float | None] = dict.fromkeys(FEATURES)
    if not np.isfinite(audio).all():
        return found
    peak = float(np.abs(audio).max(initial=0.0))
    found |= {"peak": peak, "rms": 0.0, "silent": float(peak <= SILENCE)}
    if peak <= SILENCE:
        return found
    audio = audio / peak  # squares of small numbers must not vanish
    found["rms"] = peak * float(np.sqrt(np.mean(audio**2)))
    audio = audio - audio.mean(axis=0)
    audio = audio / (np.abs(audio).max() or 1.0)
    left = np.cumsum(np.sum(audio**2, axis=1)[::-1])[::-1]
    if not left[:1] > 0.0:
        return found
    with np.errstate(divide="ignore"):
        level = 10 * np.log10(np.maximum(left, 0.0) / left[0])
    found["t60_s"] = decay(level, samplerate)
    loud = np.abs(audio).max(axis=1) > 0.01
    begin, end = int(np.argmax(loud)), int(np.searchsorted(-level, 40.0))
    power, step = spectrum(audio[begin : max(begin + 1, min(end, begin + LONGEST))], samplerate)
    found["fundamental_hz"], found["strongest_hz"] = partials(power, step)
    if power.any():
        found["centroid_hz"] = float(power @ np.arange(len(power)) / power.sum()) * step
    return found


def spectrum(audio: np.ndarray, samplerate: float) -> tuple[np.ndarray, float]:
    """Power of all channels together [bins], and the width of a bin, Hz."""
    size = 2 ** math.ceil(math.log2(2 * len(audio)))
    window = np.hanning(len(audio) + 2)[1:-1, None]
    return np.sum(np.abs(np.fft.rfft(audio * window, size, axis=0)) ** 2, axis=1), samplerate / size


def partials(power: np.ndarray, step: float) -> tuple[float | None, float | None]:
    """The lowest and the strongest partial of a spectrum with bins of `step` Hz, or None."""
    from scipy.signal import find_peaks

    lowest = math.ceil(LOWEST / step)
    heard = power[lowest:]
    if len(heard) < 3 or not heard.any():
        return None, None
    level = 10 * np.log10(heard + 1e-30 * heard.max())
    top = float(level.max())
    if top - float(np.median(level)) < TONAL:
        return None, None
    peaks = lowest + find_peaks(level, height=top - QUIET, prominence=CLEAR)[0]
    if len(peaks) == 0:
        return None, None
    strongest = peaks[np.argmax(power[peaks])]
    return vertex(power, int(peaks[0])) * step, vertex(power, int(strongest)) * step


def decay(level: np.ndarray, samplerate: float) -> float | None:
    """Time to fall by 60 dB, s, of a level [frames] that never rises; None if it does not fall so far."""
    begin, end = (int(np.searchsorted(-level, -bound)) for bound in FIT)
    if end - begin < 2 or len(level) - end < TAIL * (end - begin):
        return None
    slope = float(np.polyfit(np.arange(begin, end), level[begin:end], 1)[0]) * samplerate
    straight = (FIT[1] - FIT[0]) / (end - begin) * samplerate
    return -60.0 / slope if straight * STRAIGHT < slope < straight / STRAIGHT else None
