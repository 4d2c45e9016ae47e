"""Dither: rounding becomes a noise that does not depend on the sound."""

import numpy as np
import pytest
import soundfile

from engine.output_files import save_audio

STEP = {"PCM_16": 2.0**-15, "PCM_24": 2.0**-23}


@pytest.mark.parametrize("subtype", STEP)
def test_a_tone_below_a_step_is_heard_with_dither_alone(tmp_path, subtype):
    step = STEP[subtype]
    tone = 0.4 * step * np.sin(0.05 * np.arange(200_000))[:, None]
    found = {}
    for dither in (False, True):
        save_audio(tmp_path / "a.wav", tone, 48_000, subtype, dither)
        found[dither] = soundfile.read(tmp_path / "a.wav", always_2d=True)[0]
    assert not found[False].any()
    share = float((found[True] * tone).sum() / (tone * tone).sum())
    assert share == pytest.approx(1.0, abs=0.05)
    error = (found[True] - tone) / step
    assert error.std() == pytest.approx(0.5, abs=0.01)  # triangular noise, and rounding: √(1/6 + 1/12)
    assert abs(error.mean()) < 0.01
    save_audio(tmp_path / "b.wav", tone, 48_000, subtype, True)
    assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes()
