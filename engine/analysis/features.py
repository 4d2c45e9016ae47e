"""Features of a sound: loudness, pitch, brightness and decay in a few numbers, for tables of many sounds."""

import math

import numpy as np

from engine.analysis.metrics import parabolic_peak
from engine.output_files import SILENT_PEAK

MIN_PITCH_HZ = 20.0  # what is lower is no pitch, but bouncing or drift
FUNDAMENTAL_RANGE_DB = 20.0  # below the strongest partial, within which a lower one counts as the fundamental
PROMINENCE_DB = 10.0  # by which a partial stands above the valleys beside it
TONALITY_DB = 25.0  # of the strongest partial over the median of the spectrum; noise reaches 14
DECAY_RANGE_DB = (-5.0, -25.0)  # between which the decay is measured
MAX_SLOPE_RATIO = 1.5  # of a line fitted to the decay and one through its ends: what falls in steps is no decay
MIN_TAIL_SHARE = 0.25  # of the duration of the fit, for which the sound must go on: its end bends the curve
MAX_SPECTRUM_FRAMES = 2**21

FEATURE_NAMES = ("peak", "rms", "silent", "fundamental_hz", "strongest_hz", "centroid_hz", "t60_s")


def features(audio: np.ndarray, samplerate: float) -> dict[str, float | None]:
    """Measured features of a sound; None where one is not defined, never NaN.

    audio: float64 [frames, channels]; all channels count together, but none cancels another

    peak, rms:      in the unit of the audio (SI, if it is not normalised)
    silent:         1 if nothing can be heard, else 0
    fundamental_hz: the lowest partial within 20 dB of the strongest, from 20 Hz up; a fundamental weaker than that is
                    missed. None for noise and clicks, in which no partial stands out
    strongest_hz:   the strongest partial
    centroid_hz:    mean frequency, weighted by power; a constant offset does not count
    t60_s:          time to fall by 60 dB, from a line through -5 to -25 dB of the energy that is still to come
                    (Schroeder, J. Acoust. Soc. Am. 37, 1965); None where the sound does not fall so far, or ends
                    before it has

    All are None if a sample is not finite.
    """
    result: dict[str, float | None] = dict.fromkeys(FEATURE_NAMES)
    if not np.isfinite(audio).all():
        return result
    peak = float(np.abs(audio).max(initial=0.0))
    result |= {"peak": peak, "rms": 0.0, "silent": float(peak <= SILENT_PEAK)}
    if peak <= SILENT_PEAK:
        return result
    audio = audio / peak  # squares of small numbers must not vanish
    result["rms"] = peak * float(np.sqrt(np.mean(audio**2)))
    audio = audio - audio.mean(axis=0)
    audio = audio / (np.abs(audio).max() or 1.0)
    energy_to_come = np.cumsum(np.sum(audio**2, axis=1)[::-1])[::-1]
    if not energy_to_come[:1] > 0.0:
        return result
    with np.errstate(divide="ignore"):
        level = 10 * np.log10(np.maximum(energy_to_come, 0.0) / energy_to_come[0])
    result["t60_s"] = decay_time_60_db(level, samplerate)
    loud = np.abs(audio).max(axis=1) > 0.01
    begin, end = int(np.argmax(loud)), int(np.searchsorted(-level, 40.0))
    end = max(begin + 1, min(end, begin + MAX_SPECTRUM_FRAMES))
    power, bin_width = power_spectrum(audio[begin:end], samplerate)
    result["fundamental_hz"], result["strongest_hz"] = find_partials(power, bin_width)
    if power.any():
        result["centroid_hz"] = float(power @ np.arange(len(power)) / power.sum()) * bin_width
    return result


def power_spectrum(audio: np.ndarray, samplerate: float) -> tuple[np.ndarray, float]:
    """Power spectrum [bins] of all channels together, and the width of a bin, Hz.

    audio: [frames, channels]; a Hann window is applied, and zeros make it at least twice as long
    """
    size = 2 ** math.ceil(math.log2(2 * len(audio)))
    window = np.hanning(len(audio) + 2)[1:-1, None]
    return np.sum(np.abs(np.fft.rfft(audio * window, size, axis=0)) ** 2, axis=1), samplerate / size


def find_partials(power: np.ndarray, bin_width: float) -> tuple[float | None, float | None]:
    """Frequencies of the fundamental and of the strongest partial of a power spectrum, Hz; None if none stands out.

    power: [bins]; bin_width: Hz
    """
    from scipy.signal import find_peaks

    lowest = math.ceil(MIN_PITCH_HZ / bin_width)
    audible = power[lowest:]
    if len(audible) < 3 or not audible.any():
        return None, None
    level = 10 * np.log10(audible + 1e-30 * audible.max())
    top = float(level.max())
    if top - float(np.median(level)) < TONALITY_DB:
        return None, None
    peaks = lowest + find_peaks(level, height=top - FUNDAMENTAL_RANGE_DB, prominence=PROMINENCE_DB)[0]
    if len(peaks) == 0:
        return None, None
    strongest = peaks[np.argmax(power[peaks])]
    return parabolic_peak(power, int(peaks[0])) * bin_width, parabolic_peak(power, int(strongest)) * bin_width


def decay_time_60_db(level: np.ndarray, samplerate: float) -> float | None:
    """Time to fall by 60 dB, s, from a level in dB [frames] that never rises; None if it does not fall evenly, or not
    far enough."""
    begin, end = (int(np.searchsorted(-level, -bound)) for bound in DECAY_RANGE_DB)
    if end - begin < 2 or len(level) - end < MIN_TAIL_SHARE * (end - begin):
        return None
    slope = float(np.polyfit(np.arange(begin, end), level[begin:end], 1)[0]) * samplerate
    mean_slope = (DECAY_RANGE_DB[1] - DECAY_RANGE_DB[0]) / (end - begin) * samplerate
    return -60.0 / slope if mean_slope * MAX_SLOPE_RATIO < slope < mean_slope / MAX_SLOPE_RATIO else None
