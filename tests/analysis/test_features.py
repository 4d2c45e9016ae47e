"""Features of sounds of which they are known."""

import math

import numpy as np
import pytest

from engine.analysis.features import FEATURE_NAMES, TEXT_NAMES, features

RATE = 44_100


def ringing(*partials: tuple[float, float, float], seconds: float = 1.0, rate: int = RATE) -> np.ndarray:
    """A sound [frames, 1] of partials: frequency, Hz; amplitude; time to fall by 60 dB, s."""
    t = np.arange(round(seconds * rate)) / rate
    return sum(a * np.sin(2 * np.pi * f * t) * 10 ** (-3 * t / t60) for f, a, t60 in partials)[:, None]


@pytest.mark.parametrize("frequency", [27.5, 110.3, 987.77, 9000.0])
@pytest.mark.parametrize("t60", [0.3, math.inf])
def test_a_tone_has_its_pitch_and_its_brightness(frequency, t60):
    found = features(ringing((frequency, 1e-6, t60)), RATE)
    for name in ("fundamental_hz", "strongest_hz"):
        assert found[name] == pytest.approx(frequency, rel=0.01)
    if math.isinf(t60):
        assert found["fundamental_hz"] == pytest.approx(frequency, rel=1e-3)
        assert found["centroid_hz"] == pytest.approx(frequency, rel=0.02)


def test_the_fundamental_need_not_be_the_strongest():
    found = features(ringing((220.0, 0.2, 1.0), (441.0, 1.0, 1.0), (663.0, 0.7, 1.0)), RATE)
    assert found["fundamental_hz"] == pytest.approx(220.0, rel=2e-3)
    assert found["strongest_hz"] == pytest.approx(441.0, rel=2e-3)
    weak = features(ringing((220.0, 0.02, 1.0), (441.0, 1.0, 1.0)), RATE)
    assert weak["fundamental_hz"] == pytest.approx(441.0, rel=2e-3)


def test_what_is_slower_than_a_pitch_is_none():
    """A displacement that drifts, with a tone upon it."""
    t = np.arange(RATE)[:, None] / RATE
    found = features(10.0 + np.sin(2 * np.pi * 3.0 * t) + ringing((300.0, 1.0, math.inf)), RATE)
    assert found["fundamental_hz"] == pytest.approx(300.0, rel=2e-3)


def test_noise_and_clicks_have_no_pitch():
    noise = np.random.default_rng(1).standard_normal((RATE, 2))
    click = np.zeros((RATE, 1))
    click[100] = 1.0
    for audio in (noise, click):
        found = features(audio, RATE)
        assert found["fundamental_hz"] is None and found["strongest_hz"] is None
        assert found["centroid_hz"] == pytest.approx(RATE / 4, rel=0.02)
    assert features(noise, RATE)["t60_s"] is None


@pytest.mark.parametrize(("t60", "seconds"), [(0.05, 1.0), (0.8, 1.0), (1.5, 4.0), (4.0, 2.5)])
def test_decay_times(t60, seconds):
    late = np.concatenate([np.zeros((3000, 1)), ringing((440.0, 1.0, t60), seconds=seconds)])
    assert features(late, RATE)["t60_s"] == pytest.approx(t60, rel=0.06 if t60 > seconds else 0.01)


@pytest.mark.parametrize("t60", [math.inf, 5.0])
def test_a_sound_that_is_cut_off_has_no_decay_time(t60):
    assert features(ringing((440.0, 1.0, t60)), RATE)["t60_s"] is None


def test_levels_are_in_units_of_the_sound():
    audio = 3e-9 * np.hstack([ringing((441.0, 1.0, math.inf)), np.zeros((RATE, 1))])
    found = features(audio, RATE)
    assert found["peak"] == pytest.approx(3e-9, rel=1e-3)
    assert found["rms"] == pytest.approx(3e-9 / 2, rel=1e-6)
    assert found["silent"] == 0.0


def test_channels_do_not_cancel():
    tone = ringing((440.0, 1.0, 0.5))
    one, both = features(tone, RATE), features(np.hstack([tone, -tone]), RATE)
    assert both == pytest.approx(one)


@pytest.mark.parametrize("audio", [np.zeros((100, 1)), np.zeros((0, 2)), np.full((100, 1), 1e-200)])
def test_silence_is_said(audio):
    found = features(audio, RATE)
    assert found["silent"] == 1.0
    assert all(found[name] is None for name in ("fundamental_hz", "strongest_hz", "centroid_hz", "t60_s"))


@pytest.mark.parametrize("audio", [np.ones((1, 1)), np.ones((50, 2)), np.eye(2), np.full((9, 1), 1e300)])
def test_short_and_odd_sounds_are_free_of_nan(audio):
    found = features(audio, RATE)
    assert tuple(found) == (*FEATURE_NAMES, *TEXT_NAMES)
    assert all(found[name] is None or math.isfinite(found[name]) for name in FEATURE_NAMES)


def test_what_has_blown_up_has_no_features():
    assert set(features(np.array([[1.0], [math.nan]]), RATE).values()) == {None}


def test_a_burst_on_a_large_offset():
    """What is loud only beside what does not change, and comes after most of the energy has gone."""
    time = np.arange(44_100 * 2) / 44_100
    sound = 1.0 + 0.0095 * np.sin(2 * np.pi * 200 * time)
    sound[-200:] += 0.002 * np.sin(2 * np.pi * 3000 * time[-200:])
    found = features(sound[:, None], 44_100)
    assert found["fundamental_hz"] == pytest.approx(200.0, abs=0.5) and found["peak"] == np.abs(sound).max()
