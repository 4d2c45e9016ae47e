"""How far a sound is from a recording: sounds of which it is known."""

import numpy as np
import pytest
import soundfile

from bench.recordings.command import find_recordings, main
from bench.recordings.glide import first_level, read_glide
from bench.recordings.keys import key_name, key_number
from bench.recordings.measure import band_levels, difference, knock_level
from bench.recordings.patches import strike_once
from engine import load

RATE = 48_000
CENTRES = 1000.0 * 2.0 ** (np.arange(-3, 11) / 3)
BANDS = len(CENTRES)


def tones(levels: np.ndarray, before: float = 0.0) -> np.ndarray:
    """A tone in every third-octave band from 500 Hz to 10 kHz, dB, after a silence, s: [frames, 2]"""
    t = np.arange(round(2.2 * RATE)) / RATE
    sound = sum(10 ** (level / 20) * np.sin(2 * np.pi * f * t) for f, level in zip(CENTRES, levels, strict=True))
    return np.pad(np.stack([sound, sound], axis=1), ((round(before * RATE), 0), (0, 0)))


def apart(sound: np.ndarray, recorded: np.ndarray) -> tuple[float, float]:
    return difference(band_levels(sound, RATE), band_levels(recorded, RATE))


@pytest.mark.parametrize("gain", [1.0, 1e-3, 30.0])
def test_neither_a_gain_nor_a_silence_before_it_counts(gain):
    flat = tones(np.zeros(BANDS))
    assert apart(gain * flat, flat) == pytest.approx((0.0, 0.0), abs=1e-3)
    assert apart(gain * tones(np.zeros(BANDS), 0.3), flat) == pytest.approx((0.0, 0.0), abs=0.05)


def test_every_other_band_by_6_db_is_3_db():
    """The gain puts half of the bands 3 dB too high and half 3 dB too low."""
    uneven = tones(np.arange(BANDS) % 2 * 6.0)
    assert apart(uneven, tones(np.zeros(BANDS))) == pytest.approx((3.0, 3.0), abs=0.25)  # bands leak into each other


def test_what_is_under_the_floor_of_both_does_not_count():
    one, other = np.zeros(BANDS), np.zeros(BANDS)
    one[7:], other[7:] = -90.0, -70.0
    assert apart(tones(one), tones(other)) == pytest.approx((0.0, 0.0), abs=0.05)
    other[7:] = -40.0  # a patch that is silent there
    assert apart(tones(one), tones(other))[0] > 9.0


def test_the_knock_is_what_lies_below_the_fundamental():
    t = np.arange(RATE) / RATE
    note = np.sin(2 * np.pi * 500 * t)
    assert knock_level(note[:, None], RATE, 500.0) < -50.0
    for level in (-40, -20):
        sound = note + 10 ** (level / 20) * np.sin(2 * np.pi * 150 * t)
        assert knock_level(sound[:, None], RATE, 500.0) == pytest.approx(level, abs=0.3)


@pytest.mark.hard
def test_the_fall_of_a_pitch_is_read():
    """A tone that begins at 130 Hz and falls by 200 cents, after a silence, under a higher one that is softer."""
    t = np.arange(RATE) / RATE
    for fall in (0.0, 200.0):
        cents = fall * np.exp(-t / 0.1)
        tone = np.sin(2 * np.pi * np.cumsum(115.0 * 2 ** (cents / 1200)) / RATE) + 0.3 * np.sin(2 * np.pi * 260.0 * t)
        glide = read_glide(np.pad(np.exp(-3 * t) * tone, (RATE // 5, 0))[:, None], RATE)
        between = cents[round(0.0465 * RATE)] - cents[round(0.4 * RATE)]
        assert glide.fall() == pytest.approx(between, abs=5.0)
        assert glide.later() == pytest.approx(115.0 * 2 ** (cents[round(0.4 * RATE)] / 1200), rel=1e-3)


def test_the_level_is_that_of_the_first_tenth_of_a_second():
    t = np.arange(RATE) / RATE
    tone = np.where(t < 0.1, 1.0, 10.0) * np.sin(2 * np.pi * 1000 * t + 1.0)
    assert first_level(tone[:, None], RATE) == pytest.approx(-3.0, abs=0.1)


def test_recordings_are_found_by_their_names(tmp_path):
    (tmp_path / "grand").mkdir()
    for name in ("C4v10.ogg", "d#4v3.wav", "C4.wav", "notes.txt"):
        (tmp_path / "grand" / name).touch()
    assert set(find_recordings(tmp_path)) == {(60, 10), (63, 3)}
    assert main([str(tmp_path)]) == 2 and main([]) == 2


def test_keys_have_the_names_that_pianists_give_them():
    assert [key_number(name) for name in ("A0", "C4", "d#4", "C8")] == [21, 60, 63, 108]
    assert all(key_number(key_name(key)) == key for key in range(21, 109))


def test_a_softer_blow_is_a_slower_hammer():
    scene = strike_once(load("piano_c4"), 4)
    assert not scene.event
    assert scene.body[1].velocity == pytest.approx(2.5 * 1.12**-6)


def test_a_recording_is_not_far_from_itself(tmp_path):
    sound = tones(np.linspace(0, -40, BANDS))
    soundfile.write(tmp_path / "C4v10.wav", sound / 20, RATE, subtype="FLOAT")
    audio, rate = soundfile.read(find_recordings(tmp_path)[60, 10])
    assert difference(band_levels(audio, rate), band_levels(sound, RATE))[0] < 0.01


def test_drums_that_are_not_there_are_named(tmp_path, capsys):
    assert main([str(tmp_path), "toms"]) == 2
    assert "no recording named TomLow-0.wav" in capsys.readouterr().err
