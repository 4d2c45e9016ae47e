"""How clearly a string sings, of sounds whose answer is known, and of the sitar."""

import numpy as np
import pytest

from bench.recordings import command, singing
from bench.recordings.keys import key_frequency

RATE = 44_100
F0 = key_frequency(48)
TIME = np.arange(round(singing.SECONDS * RATE)) / RATE


def lines(orders, f0=F0):
    """Sines of size 1 at multiples of a frequency [frames, 1]."""
    return sum(np.sin(2 * np.pi * order * f0 * TIME + order) for order in orders)[:, None]


HARMONICS = lines(range(1, 41))
BETWEEN = lines(np.arange(1, 41) + 0.5)


@pytest.mark.parametrize("level", [-40.0, -28.0, -6.0, 10.0])
def test_lines_between_harmonics_have_the_level_that_they_were_given(level):
    levels = singing.harmonics_over_gaps(HARMONICS + 10 ** (level / 20) * BETWEEN, RATE, F0)
    assert levels == pytest.approx(np.full(7, -level), abs=0.5)


def test_noise_has_as_much_on_harmonics_as_between_them():
    noise = np.random.default_rng(1).standard_normal((len(TIME), 2))
    assert singing.harmonics_over_gaps(noise, RATE, F0) == pytest.approx(np.zeros(7), abs=1.0)


def test_each_window_has_its_own_time():
    """Noise for the first 0.3 s is heard in the windows that reach into it, and in no others."""
    noise = 3.0 * np.random.default_rng(2).standard_normal(HARMONICS.shape) * (TIME < 0.3)[:, None]
    levels = singing.harmonics_over_gaps(HARMONICS + noise, RATE, F0)
    assert (levels[:2] < 20.0).all() and (levels[2:] > 50.0).all()


def test_what_lies_below_1_and_above_4_khz_does_not_count():
    far = lines([0.5, 5.5, 33.5, 60.5])
    assert (singing.harmonics_over_gaps(HARMONICS + far, RATE, F0) > 50.0).all()


@pytest.mark.parametrize("cents", [-30.0, 0.0, 24.0])
def test_the_fundamental_is_found_near_the_key(cents):
    found = singing.measure_singing((lines(range(1, 41), F0 * 2 ** (cents / 1200)), RATE), 48)
    assert found.levels.min() > 50.0
    assert found.cents == pytest.approx(cents, abs=4.0)


def test_a_stiff_string_whose_partials_are_no_harmonics_does_not_sing():
    orders = np.arange(1, 33)
    found = singing.measure_singing((lines(orders * np.sqrt(1 + 3e-4 * orders**2)), RATE), 48)
    assert found.levels.max() < 12.0


def test_power_above_an_edge():
    sound = lines([1.0], 1000.0) + 0.1 * lines([1.0], 14_000.0)
    assert singing.power_above(sound, RATE) == pytest.approx(-20.0, abs=0.1)


@pytest.mark.hard
@pytest.mark.parametrize("key", [48, 55, 60, 67, 72])
def test_the_sitar_sings_at_each_velocity(key):
    notes = [singing.measure_singing(sound, key) for sound in singing.render_notes("sitar", key)]
    assert len(notes) == len(singing.VELOCITIES)
    assert min(note.levels.min() for note in notes) >= singing.WANTED


@pytest.mark.hard
@pytest.mark.parametrize("key", [36, 43, 48])
def test_the_tanpura_does_not_hiss(key):
    fizz = [singing.power_above(*sound) for sound in singing.render_notes("tanpura_body", key)]
    assert len(fizz) == len(singing.VELOCITIES) and max(fizz) < -40.0


def test_a_patch_that_is_not_measured_is_refused(capsys):
    assert command.main(["singing", "snare"]) == 2
    assert capsys.readouterr().err == "bench recordings singing: snare is not one of sitar, tanpura_body, tanpura\n"
