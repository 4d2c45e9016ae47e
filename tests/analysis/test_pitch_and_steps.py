"""How the bench reads pitches and compares steps: sounds of known pitch, silence, and some keys of each instrument."""

import math

import numpy as np
import pytest

from bench.accuracy import pitch, steps

RATE = 44_100


def cents(found: float, right: float) -> float:
    return 1200 * math.log2(found / right)


def times(seconds: float) -> np.ndarray:
    return np.arange(round(seconds * RATE)) / RATE


def noise(size: int, level_db: float) -> np.ndarray:
    return 10 ** (level_db / 20) * np.random.default_rng(1).standard_normal(size)


def stiff_string(first: float, stiffness: float, lowest: int = 1) -> np.ndarray:
    """A decaying string whose first partial has a frequency; partials below the lowest are missing: [frames, 1]"""
    time = times(pitch.string_seconds(first))
    sound = noise(time.size, -70.0)
    for n in range(lowest, 40):
        frequency = n * first * math.sqrt((1 + stiffness * n**2) / (1 + stiffness))
        if frequency < 15_000:
            sound += np.exp(-(1 + 0.2 * n) * time) * np.sin(2 * np.pi * frequency * time + n * n) / n
    return sound[:, None]


@pytest.mark.parametrize(("first", "stiffness"), [(27.3, 2.3e-4), (82.0, 1e-5), (261.0, 2.9e-4), (659.0, 1e-5)])
@pytest.mark.parametrize("lowest", [1, 2])
def test_the_pitch_of_a_string_is_that_of_its_first_partial(first, stiffness, lowest):
    """Within 0.3 cents, also where the first partial cannot be heard; sought 8 cents beside it."""
    sound = stiff_string(first, stiffness, lowest)
    assert abs(cents(pitch.string_pitch(sound, RATE, first * 2 ** (8 / 1200)), first)) <= 0.3


@pytest.mark.parametrize("off", [-30.0, 0.0, 30.0])
@pytest.mark.parametrize("first", [110.0, 440.0, 1760.0, 4200.0])
def test_a_first_partial_is_told_from_others_and_from_what_is_struck_with_it(first, off):
    """Beside the second partial of a bar, and a mode of its frame 250 cents below that dies in a moment; with noise."""
    time = times(pitch.STRUCK_SECONDS)
    sound = np.exp(-3 * time) * np.sin(2 * np.pi * first * time) + noise(time.size, -60.0)
    sound += np.exp(-20 * time) * np.sin(2 * np.pi * 2.76 * first * time)
    sound += np.exp(-200 * time) * np.sin(2 * np.pi * first * 2 ** (-250 / 1200) * time)
    found = pitch.first_partial(sound[:, None], RATE, first * 2 ** (off / 1200))
    assert abs(cents(found, first)) <= 0.5


@pytest.mark.parametrize("off", [-17.0, 0.0, 17.0])
@pytest.mark.parametrize("first", [196.0, 440.0, 1318.0])
def test_the_pitch_of_a_bowed_note_is_the_mean_over_its_vibrato(first, off):
    """Of 15 cents either way, while a body makes it softer and louder; and though the first partial is weak."""
    time = times(pitch.bowed_seconds(first))
    swing = np.sin(2 * np.pi * (time - pitch.BEGIN) / pitch.TURN)
    phase = 2 * np.pi * np.cumsum(first * 2 ** (15 * swing / 1200)) / RATE
    sound = sum((1 + 0.3 * swing) / (20 if n == 1 else n) * np.sin(n * phase) for n in range(1, 9) if n * first < 15e3)
    found = pitch.bowed_pitch(sound[:, None] + noise(time.size, -60.0)[:, None], RATE, first * 2 ** (off / 1200))
    assert abs(cents(found, first)) <= 0.3


@pytest.mark.parametrize("read", [pitch.string_pitch, pitch.first_partial, pitch.bowed_pitch])
@pytest.mark.parametrize("near", [100.0, 2000.0])
def test_silence_has_no_pitch(read, near):
    assert math.isnan(read(np.zeros((3 * RATE, 2)), RATE, near))


def test_a_row_says_what_is_worst_and_what_has_no_pitch():
    of = pitch.INSTRUMENTS[0]
    readings = [pitch.Reading(60 + n, v, c) for v in pitch.VELOCITIES for n, c in enumerate((3.0, -4.0))]
    readings[0] = readings[0]._replace(cents=math.nan)
    assert pitch.row_of(of, readings) == [of.patch, "2", "4.0", "C#4 -4.0", *2 * ("3.5", "C#4 -4.0"), "C4 at 30"]


def test_sounds_that_differ_by_a_gain_are_alike_and_a_band_that_is_louder_is_seen():
    time = times(steps.SECONDS)
    lines = [np.sin(2 * np.pi * f * time) for f in (250.0, 1000.0, 4000.0)]
    sound = np.stack([sum(lines), lines[0]], axis=1)
    assert steps.compare_sounds(sound, 0.1 * sound) == pytest.approx((0.0, 0.0), abs=0.03)
    brighter = np.stack([sum(lines) + lines[2], lines[0]], axis=1)
    assert min(steps.compare_sounds(sound, brighter)) > 1.5


def some_keys() -> list:
    """The lowest, a middle and the highest key of each instrument in tune."""
    tuned = [of for of in pitch.INSTRUMENTS if of.patch not in ("sitar", "tanpura_body")]
    return [pytest.param(of, share, id=f"{of.patch}-{share}") for of in tuned for share in (0.0, 0.5, 1.0)]


@pytest.mark.hard
@pytest.mark.parametrize("velocity", pitch.VELOCITIES)
@pytest.mark.parametrize(("of", "share"), some_keys())
def test_keys_are_in_tune(of, share, velocity):
    """Within 10 cents of the tuning of their keyboard. The open string of the slide needs a pluck to sound."""
    keys = pitch.keys_of_instrument(of)
    reading = pitch.read_key(of, keys[round(share * (len(keys) - 1))], velocity)
    if (of.patch, share, velocity) == ("guitar_slide", 0.0, 30):
        assert math.isnan(reading.cents)
    else:
        assert abs(reading.cents) <= 10.0


@pytest.mark.hard
@pytest.mark.parametrize("patch", ["violin", "piano_c7", "bowed_vibraphone", "kalimba"])
def test_more_steps_change_a_patch_little(patch):
    """2 dB in third octaves, in frames as in all together, at the steps that the patch sets or has by default."""
    assert max(steps.compare_steps(patch)[1][0]) <= 2.0
