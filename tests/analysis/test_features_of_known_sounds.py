"""Features of two hundred synthetic sounds whose features are known (bench/scenes/known_sounds.py)."""

import numpy as np
import pytest

from bench.accuracy.features import feature_errors
from bench.scenes.known_sounds import KINDS, TO_60_DB, Partial
from engine.analysis.features import features


def test_there_are_two_hundred_of_eleven_kinds():
    assert sum(count for _, count in KINDS) >= 200 and len({make for make, _ in KINDS}) == 11


def test_the_energy_of_a_mode_that_is_struck_again_is_that_of_its_sound():
    """What the set knows, by a closed form, against a sum over samples."""
    partial = Partial(300.0, 1.0, ((0.0, 1.0, 0.3), (0.4, 0.7, 2.0), (0.5, 1.2, 5.0)))
    time = np.arange(200_000) / 200_000
    known = partial.energy_to_come(np.array([0.0, 0.2, 0.45, 0.7]), 1.0)
    power = partial.sound(time) ** 2 / 200_000
    assert known == pytest.approx([power[time >= begin].sum() for begin in (0.0, 0.2, 0.45, 0.7)], rel=0.01)


@pytest.mark.hard_for("1", "5", "8", "0", "2", "3", "4", "7", "10")
@pytest.mark.parametrize("kind", range(len(KINDS)))
def test_features_are_those_that_are_known(kind):
    make, count = KINDS[kind]
    random = np.random.default_rng([0, kind])
    for n in range(count):
        found = feature_errors(make(random, n))
        name = f"{found.sound.kind}: {found.sound.name}"
        assert found.fundamental is None or abs(found.fundamental) < 0.5, name
        assert found.strongest is None or abs(found.strongest) < 0.5, name
        assert found.centroid is None or abs(found.centroid) < 0.01, name
        assert found.t60 is None or abs(found.t60) < 0.05, name
        assert (found.t60 is None) == (found.reason is not None), name


@pytest.mark.parametrize(("amplitude", "strongest"), [(0.0, 1000.0), (1.0, 1000.0), (3.0, 1000.0), (10.0, 5000.0)])
def test_brightness_hears_the_attack(amplitude, strongest):
    """Two velocities that begin at once, of 1 kHz for 2 s and of 5 kHz for 0.05 s: Σ f·A²·T60 / Σ A²·T60."""
    time = np.arange(3 * 44_100) / 44_100
    modes = (1000.0, 2.0, 1.0), (5000.0, 0.05, amplitude)
    sound = sum(a * np.exp(-TO_60_DB * time / t60) * np.cos(2 * np.pi * f * time) for f, t60, a in modes)
    found = features(sound[:, None], 44_100)
    energy = sum(a**2 * t60 for _, t60, a in modes)
    assert found["centroid_hz"] == pytest.approx(sum(f * a**2 * t60 for f, t60, a in modes) / energy, rel=1e-3)
    assert found["strongest_hz"] == pytest.approx(strongest, rel=1e-6)


def test_the_reason_for_no_decay_time_is_said():
    time = np.arange(2 * 44_100) / 44_100

    def reason(sound: np.ndarray) -> str:
        found = features(sound[:, None], 44_100)
        assert found["t60_s"] is None
        return found["t60_reason"]

    tone = np.sin(2 * np.pi * 440 * time)
    beats = np.exp(-4 * time) * (tone + np.sin(2 * np.pi * 441 * time))
    slopes = np.exp(-20 * time) * tone + 0.05 * np.exp(-2 * time) * np.sin(2 * np.pi * 660 * time)
    assert reason(tone) == reason(np.exp(-time) * tone) == "it ends before it has fallen by 25 dB"
    assert "beats" in reason(beats) and "a fade" in reason((1 - time / 2) * tone)
    assert reason(slopes).startswith("two slopes: 0.") and "s from -15 to -25 dB" in reason(slopes)
    damped = slopes * np.where(time < 1.2, 1.0, np.exp(-30 * (time - 1.2)))  # after the range, which has two slopes
    assert reason(damped).startswith("two slopes: 0.")
    assert reason(np.exp(-1000 * time) * np.sin(2 * np.pi * 300 * time)) == "it falls by 20 dB in less than two periods"
    assert features(np.exp(-7 * time)[:, None] * tone[:, None], 44_100)["t60_reason"] is None
