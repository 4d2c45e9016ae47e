"""Begins and ends of sounds: against the decay that a scene is given."""

import math

import numpy as np
import pytest

import engine
from bench.scenes.small import oscillator, scene
from engine.sound.cut import fade_out, find_audible_frames, find_cut, find_levels, make_loop
from engine.sound.form import SoundForm
from engine.sound.sound_file import cut_sound

RATE = 44_100
DECIBELS = 20.0 / math.log(10.0)  # of e


def ringing(seconds: float, rate: float) -> np.ndarray:
    """A mode of 440 Hz whose amplitude decays at a rate, 1/s: ẍ + 2·rate·ẋ + ω²x = 0."""
    body = oscillator(frequency=440.0, displacement=1e-3, damping_rate=2 * rate)
    return engine.render(scene([body]), seconds=seconds, silence=-np.inf).audio


@pytest.mark.parametrize("rate", [4.0, 20.0])
def test_a_trimmed_sound_ends_where_it_is_70_dB_down(rate):
    seconds = 70.0 / (DECIBELS * rate)
    cut = cut_sound(SoundForm(trim=True), ringing(1.5 * seconds, rate), RATE)
    assert len(cut.audio) / RATE == pytest.approx(seconds, abs=1 / 440 + 1e-3)
    assert cut.cut is None


@pytest.mark.parametrize("rate", [2.0, 4.0, 20.0])
@pytest.mark.parametrize("level", [-10.0, -30.0, -50.0])
def test_it_is_said_how_long_a_sound_would_have_gone_on(rate, level):
    audio = ringing(-level / (DECIBELS * rate), rate)
    found = find_cut(audio, RATE)
    assert found.level == pytest.approx(level, abs=0.1 + DECIBELS * rate * 0.02)
    assert found.seconds == pytest.approx((70.0 + level) / (DECIBELS * rate), rel=0.02, abs=0.03)
    assert str(found).startswith(f"cut at {round(found.level)} dB; it rings for ")


def test_a_sound_without_loss_does_not_die_away():
    assert str(find_cut(ringing(0.5, 0.0), RATE)) == "cut at 0 dB; it does not die away"


def test_silence_before_a_sound_is_left_out():
    late = np.vstack([np.full((5000, 1), 1e-9), ringing(0.5, 40.0)])
    begin, _ = find_audible_frames(late)
    assert begin in (5000, 5001)  # the first sample of the velocity is zero
    assert len(cut_sound(SoundForm(trim=False), late, RATE).audio) == len(late)


def test_a_cut_sound_fades_to_zero_within_5_ms_and_is_untouched_before():
    audio = ringing(0.5, 1.0)
    faded = cut_sound(SoundForm(), audio, RATE).audio
    last = math.ceil(0.005 * RATE)
    np.testing.assert_array_equal(faded[:-last], audio[:-last])
    assert faded[-1] == 0.0 and not np.array_equal(faded[-last:], audio[-last:])
    np.testing.assert_array_equal(cut_sound(SoundForm(fade=False), audio, RATE).audio, audio)


def test_a_sound_that_has_died_away_is_as_it_is():
    audio = ringing(1.0, 20.0)
    np.testing.assert_array_equal(cut_sound(SoundForm(), audio, RATE).audio, audio)


@pytest.mark.parametrize("frames", [0, 1, 7])
def test_the_shortest_sounds_are_cut_without_a_fault(frames):
    audio = np.ones((frames, 2))
    assert len(fade_out(audio, RATE)) == len(audio)
    assert len(find_levels(audio, RATE)) <= 1
    assert find_audible_frames(audio) == (0, frames)
    assert len(make_loop(audio, 100)) == frames - frames // 2


def test_a_loop_goes_on_at_its_begin_as_it_ends():
    """Noise repeated: no step at the seam is larger than elsewhere, and the level stays within half a decibel."""
    noise = np.random.default_rng(1).standard_normal((RATE, 1)).cumsum(axis=0)
    noise -= np.linspace(noise[0], noise[-1], len(noise))
    looped = make_loop(noise, RATE // 4)
    twice = np.vstack([looped, looped])
    steps = np.abs(np.diff(twice[:, 0]))
    assert steps[len(looped) - 1] <= steps[: len(looped) - 1].max()
    white = np.random.default_rng(2).standard_normal((2 * RATE, 1))
    looped = make_loop(white, RATE)
    within, after = looped[:RATE].std(), white[: 2 * RATE].std()
    assert 20 * abs(math.log10(within / after)) < 0.5
