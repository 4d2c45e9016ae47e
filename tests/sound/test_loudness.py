"""Loudness, against another implementation of the standard: libebur128."""

import math

import numpy as np
import pytest

from engine.output_files import NORMALISED_PEAK_DBFS
from engine.sound.form import SoundForm
from engine.sound.loudness import loudness_of
from engine.sound.sound_file import SoundFile

RATES = 44_100, 48_000, 96_000


def measured(audio: np.ndarray, rate: int) -> float:
    """The integrated loudness by libebur128, LUFS; of less than 400 ms, the greatest momentary one."""
    pyebur128 = pytest.importorskip("pyebur128")
    if len(audio) >= 0.4 * rate:
        state = pyebur128.R128State(audio.shape[1], rate, pyebur128.MeasurementMode.MODE_I)
        state.add_frames(np.ascontiguousarray(audio).ravel(), len(audio))
        return pyebur128.get_loudness_global(state)
    state = pyebur128.R128State(audio.shape[1], rate, pyebur128.MeasurementMode.MODE_M)
    padded = np.vstack([np.zeros_like(audio), audio, np.zeros((round(0.4 * rate) - len(audio), audio.shape[1]))])
    state.add_frames(np.ascontiguousarray(padded).ravel(), len(padded))
    return pyebur128.get_loudness_momentary(state)


def knock(rate: int, seconds: float, channels: int = 1) -> np.ndarray:
    """A decaying tone with noise in it."""
    t = np.arange(round(seconds * rate)) / rate
    tone = np.exp(-9.0 * t) * (np.sin(2e3 * t) + 0.3 * np.random.default_rng(3).standard_normal(len(t)))
    return np.stack([tone * 0.8**n for n in range(channels)], axis=1) * 0.3


@pytest.mark.parametrize("rate", [44_100, *(pytest.param(rate, marks=pytest.mark.hard) for rate in RATES[1:])])
@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("seconds", [0.05, 0.2, 1.0, 4.0])
def test_loudness_is_that_of_another_implementation(rate, channels, seconds):
    audio = knock(rate, seconds, channels)
    assert loudness_of(audio, rate) == pytest.approx(measured(audio, rate), abs=0.2)


@pytest.mark.parametrize("target", [-30.0, -23.0])
@pytest.mark.parametrize("seconds", [0.1, 1.5])
def test_a_file_has_the_loudness_that_was_asked_for(tmp_path, target, seconds):
    sound = SoundFile(tmp_path / "a.wav", SoundForm(loudness=target, fade=False)).prepare(
        knock(48_000, seconds), 48_000
    )
    assert measured(sound.audio, 48_000) == pytest.approx(target, abs=0.2)
    assert sound.loudness == pytest.approx(target, abs=1e-9)
    assert not any("LUFS" in line for line in sound.warnings)


def test_no_peak_is_above_the_ceiling_and_that_is_said(tmp_path):
    click = np.zeros((48_000, 1))
    click[100] = 1.0
    sound = SoundFile(tmp_path / "a.wav", SoundForm(loudness=-10.0)).prepare(click, 48_000)
    assert 20 * math.log10(np.abs(sound.audio).max()) == pytest.approx(NORMALISED_PEAK_DBFS)
    assert sound.loudness < -30.0
    assert any("at -10 its peak would exceed -1 dBFS" in line for line in sound.warnings)


def test_of_silence_there_is_no_loudness(tmp_path):
    sound = SoundFile(tmp_path / "a.wav", SoundForm(loudness=-10.0)).prepare(np.zeros((100, 1)), 48_000)
    assert sound.loudness is None and [line for line in sound.warnings if "the sound is silent" in line]


def test_more_channels_than_the_standard_has_are_refused():
    with pytest.raises(ValueError, match="up to 5 channels"):
        loudness_of(np.ones((48_000, 6)), 48_000)
