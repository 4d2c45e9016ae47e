"""What is read of the partials of a recorded note: strings of which it is known."""

import numpy as np
import pytest

from bench.recordings.brightness import brightness, brightness_slope
from bench.recordings.decay import median_decays, partial_decays
from bench.recordings.keys import key_frequency
from bench.recordings.partials import Partials, read_partials

RATE = 48_000
COMPASS = [(21, 2.3e-4), (36, 8.9e-5), (60, 2.9e-4), (84, 2.4e-3), (96, 6.5e-3), (105, 1.3e-2)]
BEATS = 0.4  # cents between two strings of a choir


def stiff_string(
    fundamental: float,
    stiffness: float,
    seconds: float = 4.0,
    early: float = 0.0,
    late: float = 0.0,
    knee: float = 0.5,
    without: tuple[int, ...] = (),
    noise_db: float = -90.0,
    tilt: float = 1.0,
) -> np.ndarray:
    """Partials below 15 kHz, n-th as n^-tilt, that fall by two slopes, dB/s; with noise: [frames, 1]"""
    t = np.arange(round(seconds * RATE)) / RATE
    fall = 10 ** (-(early * np.minimum(t, knee) + late * np.maximum(t - knee, 0.0)) / 20)
    sound = 10 ** (noise_db / 20) * np.random.default_rng(0).standard_normal(len(t))
    for n in range(1, 60):
        frequency = n * fundamental * np.sqrt(1 + stiffness * n**2)
        if n not in without and frequency < 15_000:
            sound += fall * np.sin(2 * np.pi * frequency * t + n * n) / n**tilt
    return sound[:, None]


def string_of(fundamental: float, stiffness: float) -> Partials:
    return Partials(fundamental, stiffness, np.arange(0), np.zeros(0))


@pytest.mark.hard_for(
    "-25.0-21-0.00023",
    "-25.0-36-8.9e-05",
    "-25.0-60-0.00029",
    "0.0-21-0.00023",
    "0.0-36-8.9e-05",
    "0.0-60-0.00029",
    "30.0-21-0.00023",
    "30.0-36-8.9e-05",
    "30.0-60-0.00029",
)
@pytest.mark.parametrize(("key", "stiffness"), COMPASS)
@pytest.mark.parametrize("cents", [-25.0, 0.0, 30.0])
def test_a_string_is_known_by_its_partials_over_the_compass(key, stiffness, cents):
    fundamental = key_frequency(key) * 2 ** (cents / 1200)
    read = read_partials(stiff_string(fundamental, stiffness, early=20.0, late=5.0), RATE, key_frequency(key))
    assert read.fundamental == pytest.approx(fundamental, rel=2e-4)
    assert read.inharmonicity == pytest.approx(stiffness, rel=0.02)
    assert read.pitch == pytest.approx(fundamental * np.sqrt(1 + stiffness), rel=2e-4)
    assert read.frequencies == pytest.approx([read.predict(n) for n in read.numbers], rel=1e-3)


@pytest.mark.hard
def test_partials_that_are_missing_and_tones_beside_them_do_not_mislead():
    """As in the bass, whose first partials hardly sound, and where the hammer strikes at a node."""
    stiffness = 2.3e-4
    sound = stiff_string(27.3, stiffness, without=(1, 2, 8, 16, 24), noise_db=-60.0)
    t = np.arange(len(sound)) / RATE
    for stranger in (96.0, 333.0, 457.0):  # resonances of the case, stretched strings
        sound[:, 0] += 0.1 * np.sin(2 * np.pi * stranger * t)
    read = read_partials(sound, RATE, 27.5)
    assert read.inharmonicity == pytest.approx(stiffness, rel=0.03)
    assert not {1, 2, 8, 16, 24} & set(read.numbers.tolist())
    assert len(read.numbers) > 25


@pytest.mark.hard
def test_a_choir_that_beats_is_one_string():
    one, other = (stiff_string(262.0 * 2 ** (c / 1200), 2.9e-4, 3.0) for c in (-BEATS / 2, BEATS / 2))
    read = read_partials(one + other, RATE, 261.6)
    assert (read.fundamental, read.inharmonicity) == pytest.approx((262.0, 2.9e-4), rel=0.01)


def test_noise_has_no_partials_and_two_tell_no_stiffness():
    noise = np.random.default_rng(1).standard_normal((2 * RATE, 1))
    read = read_partials(noise, RATE, 261.6)
    assert read is None or len(read.numbers) < 8
    two = read_partials(stiff_string(4186.0, 1e-2, 2.0, without=(3, 4, 5)), RATE, 4186.0)
    assert len(two.numbers) == 2 and np.isnan(two.inharmonicity)


@pytest.mark.hard_for("21-0.00023", "60-0.00029", "36-8.9e-05", "84-0.0024")
@pytest.mark.parametrize(("key", "stiffness"), [*COMPASS[:-1]])
def test_partials_that_fall_in_two_stages_are_seen_to(key, stiffness):
    """From A0, whose window is 145 ms, to C7."""
    fundamental = key_frequency(key)
    sound = stiff_string(fundamental, stiffness, 8.0, early=30.0, late=4.0)
    assert median_decays(sound, RATE, string_of(fundamental, stiffness)) == pytest.approx((-30.0, -4.0), rel=0.1)


@pytest.mark.hard
def test_a_partial_is_followed_to_the_noise_and_no_further():
    """Noise that stays is no late decay."""
    fundamental = key_frequency(84)
    sound = stiff_string(fundamental, 2.4e-3, 8.0, early=40.0, late=40.0, noise_db=-50.0)
    early, late = median_decays(sound, RATE, string_of(fundamental, 2.4e-3))
    assert (early, late) == pytest.approx((-40.0, -40.0), rel=0.15)


@pytest.mark.hard
def test_each_partial_has_its_own_slopes():
    string = string_of(262.0, 2.9e-4)
    sound = stiff_string(262.0, 2.9e-4, early=20.0, late=20.0, without=(3, 7), noise_db=-70.0)
    slopes = partial_decays(sound, RATE, string)
    assert np.isnan(slopes[[2, 6]]).all()
    assert np.delete(slopes, [2, 6], axis=0) == pytest.approx(-20.0, rel=0.1)


def test_brightness_is_what_lies_above_2_khz():
    t = np.arange(3 * RATE) / RATE
    for share in (-30.0, -10.0):
        sound = np.sin(2 * np.pi * 500 * t) + 10 ** (share / 20) * np.sin(2 * np.pi * 4000 * t)
        read = brightness(sound[:, None], RATE)
        part = 10 ** (share / 10)
        assert read.share == pytest.approx(10 * np.log10(part / (1 + part)), abs=0.05)
        assert read.centroid == pytest.approx((500 + 4000 * part) / (1 + part), rel=0.01)
        assert read.level == pytest.approx(10 * np.log10((1 + part) / 2), abs=0.05)


def test_brightness_rises_with_level_by_its_slope():
    """Three velocities, of which the share above 2 kHz rises 1.7 dB per dB."""
    t = np.arange(3 * RATE) / RATE
    notes = []
    for level in (-30.0, -20.0, -10.0):
        bright = 10 ** ((-30.0 + 1.7 * (level + 20.0)) / 20)
        sound = 10 ** (level / 20) * (np.sin(2 * np.pi * 500 * t) + bright * np.sin(2 * np.pi * 4000 * t))
        notes.append(brightness(sound[:, None], RATE))
    assert brightness_slope(notes) == pytest.approx(1.7, rel=0.03)
    assert np.isnan(brightness_slope(notes[:1]))
