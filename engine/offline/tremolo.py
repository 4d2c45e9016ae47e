"""The tremolo of rendered audio: the same as of live sound (engine.live.audio_thread)."""

import numpy as np

from engine.patch.tremolo import Tremolo


def apply_tremolo(audio: np.ndarray, tremolo: Tremolo | None, samplerate: int) -> np.ndarray:
    """Return audio [frames, channels] with its tremolo, if there is one."""
    if tremolo is None or tremolo.depth == 0.0:
        return audio
    from engine.runtime.tremolo import tremolo_gain

    frames, channels = audio.shape
    turns = np.arange(frames)[:, None] * (tremolo.rate / samplerate) + np.arange(channels) * tremolo.spread
    return np.asarray(audio * tremolo_gain.py_func(turns, tremolo.depth))
