"""Loudness of sounds, after ITU-R BS.1770-4."""

import math

import numpy as np

BLOCK_SECONDS = 0.4  # of the momentary loudness
MAX_CHANNELS = 5


def loudness_of(audio: np.ndarray, samplerate: int) -> float | None:
    """Return the integrated loudness of a sound [frames, channels], LUFS; of one shorter than 400 ms, the momentary
    loudness at the time when all of it counts. None of silence. Raises ValueError for more than five channels."""
    import pyloudnorm

    if audio.shape[1] > MAX_CHANNELS:
        raise ValueError(f"loudness is defined for up to {MAX_CHANNELS} channels; there are {audio.shape[1]}")
    peak = float(np.abs(audio).max(initial=0.0))
    if peak == 0.0:
        return None
    block = math.ceil(BLOCK_SECONDS * samplerate) + 1
    padded = np.zeros((max(block, len(audio)), audio.shape[1]))
    padded[: len(audio)] = audio / peak  # the gate of the standard is at an absolute level
    integrated = pyloudnorm.Meter(samplerate).integrated_loudness(padded)
    return float(integrated) + 20.0 * math.log10(peak) if math.isfinite(integrated) else None
