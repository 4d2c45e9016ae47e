"""Features of a sound: loudness, pitch, brightness and decay in a few numbers, for tables of many sounds."""

from typing import Any

import numpy as np

from engine.analysis.decay import measure_decay
from engine.analysis.partials import centroid_of, find_partials
from engine.output_files import SILENT_PEAK

MAX_SECONDS = 60.0  # after the onset: of a longer sound only so much
ENDED_DB = 60.0  # below all the energy, where a sound has ended
TAPER_SECONDS = 0.01  # of what is cut off

FEATURE_NAMES = ("peak", "rms", "silent", "fundamental_hz", "strongest_hz", "centroid_hz", "t60_s")
TEXT_NAMES = ("t60_reason",)  # features that are words


def features(audio: np.ndarray, samplerate: float) -> dict[str, Any]:
    """Measured features of a sound; None where one is not defined, never NaN.

    audio: float64 [frames, channels]; all channels count together, but none cancels another

    peak, rms:      in the unit of the audio (SI, if it is not normalised)
    silent:         1 if nothing can be heard, else 0
    fundamental_hz: the lowest partial within 20 dB (of energy) of the strongest, from 20 Hz up; a fundamental weaker
                    than that is missed. Partials nearer than about 10 Hz count as one. A partial is found as a peak in
                    the sum of the power spectra of windows of 0.4 s over all of the sound, and its frequency is how
                    fast the phase of its band turns, whenever and however often it is struck. None for noise, clicks
                    and pushes, in which no partial stands out
    strongest_hz:   the partial with the most energy over all of the sound, found likewise
    centroid_hz:    mean frequency from 20 Hz up, weighted by the power of the whole sound, its attack included: of
                    decaying partials Σ f·A²·T60 / Σ A²·T60. A step at the begin and a constant offset do not count
    t60_s:          time to fall by 60 dB, as the mean slope from -5 to -25 dB of the energy that is still to come
                    (Schroeder, J. Acoust. Soc. Am. 37, 1965); what a sound that is cut off would have had after its end
                    is estimated. Of several strikes it is that after the last; of two slopes, that between these
                    levels. None if the slope changes by more than half there, if the sound is cut off before it has
                    fallen by 25 dB, if it falls by 20 dB in less than two periods, or if it falls faster and faster,
                    as no decaying modes do, but beats, fades and dampers
    t60_reason:     why t60_s is None, in words; else None

    All are None if a sample is not finite.
    """
    result: dict[str, Any] = dict.fromkeys((*FEATURE_NAMES, *TEXT_NAMES))
    if not np.isfinite(audio).all():
        return result
    peak = float(np.abs(audio).max(initial=0.0))
    result |= {"peak": peak, "rms": 0.0, "silent": float(peak <= SILENT_PEAK)}
    if peak <= SILENT_PEAK:
        return result
    audio = audio / peak  # squares of small numbers must not vanish
    result["rms"] = peak * float(np.sqrt(np.mean(audio**2)))
    sound = remove_offset(audio)
    power = np.sum(sound**2, axis=1)
    energy_to_come = np.cumsum(power[::-1])[::-1]
    if not energy_to_come[0] > 0.0:
        return result
    begin = int(np.argmax(power > 1e-6 * power.max()))
    end = int(np.searchsorted(-energy_to_come, -energy_to_come[0] * 10 ** (-ENDED_DB / 10)))
    sound = taper(sound[begin : max(begin + 1, min(end, begin + round(MAX_SECONDS * samplerate)))], samplerate)
    result["centroid_hz"] = centroid_of(sound, samplerate)
    result["fundamental_hz"], result["strongest_hz"] = find_partials(sound, samplerate)
    result["t60_s"], result["t60_reason"] = measure_decay(
        power[begin:],
        samplerate,
        result["fundamental_hz"] or result["centroid_hz"],
        result["fundamental_hz"] is not None,
    )
    return result


def remove_offset(audio: np.ndarray) -> np.ndarray:
    """Return a sound [frames, channels] about the level at which its second half ends, its largest sample being 1. A
    mean of all of it would put a step under a short sound on one side."""
    half = audio[len(audio) // 2 :]
    weight = np.hanning(len(half) + 2)[1:-1]
    sound = audio - weight @ half / weight.sum()
    return np.asarray(sound / (np.abs(sound).max() or 1.0))


def taper(sound: np.ndarray, samplerate: float) -> np.ndarray:
    """Return a sound [frames, channels] whose last samples fade out, so that its end is no click."""
    frames = min(round(TAPER_SECONDS * samplerate), len(sound) // 20)
    fade = np.ones(len(sound))
    fade[len(sound) - frames :] = 0.5 + 0.5 * np.cos(np.pi * (np.arange(frames) + 1) / (frames + 1))
    return sound * fade[:, None]
