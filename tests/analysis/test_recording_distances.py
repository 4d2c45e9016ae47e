"""Distances of notes from recorded ones: sounds of which they are known."""

import math
from functools import cache

import numpy as np
import pytest

from bench.recordings import peers
from bench.recordings.distances import (
    ANOTHER_LAYER,
    NEIGHBOUR,
    attack_distance,
    compare_layers,
    level_and_brightness,
    spectral_distance,
    windows_distance,
)
from bench.recordings.keys import layer_velocity
from bench.recordings.measure import CENTRES, band_powers, noise_powers
from bench.recordings.note import Note
from bench.recordings.octaves import OCTAVES, channel_correlation
from bench.recordings.summary import level_errors, octave_means, unevenness

RATE = 22_050
KEY = 48
DISTANCES = (spectral_distance, windows_distance, attack_distance)


@cache
def strike(
    seconds: float = 4.0, fall: float = 40.0, noise: float = 0.0, gain: float = 0.0, high: float = 0.0, seed: int = 1
) -> np.ndarray:
    """Tones in third octaves from 125 Hz to 8 kHz that fall, dB/s, in noise; two channels out of step.

    gain, dB: of the tones; high, dB: of those above 2 kHz beside the rest
    """
    t = np.arange(round(seconds * RATE)) / RATE
    sound = np.zeros((len(t), 2))
    for n, frequency in enumerate(CENTRES[7:26]):
        level = gain - n + (high if frequency > 1900 else 0.0)
        phase = 2 * np.pi * frequency * t[:, None] + np.array([n, 2 * n])
        sound += 10 ** ((level - fall * t[:, None]) / 20) * np.sin(phase)
    fade = np.clip((seconds - t[:, None]) / (0.15 * seconds), 0.0, 1.0)
    return fade * (sound + noise * np.random.default_rng(seed).standard_normal(sound.shape))


def note(is_recording: bool = False, **changes) -> Note:
    return Note((strike(**changes), RATE), KEY, is_recording)


@pytest.mark.hard_for("spectral_distance")
@pytest.mark.parametrize("distance", DISTANCES)
def test_equal_sounds_are_not_apart_at_any_gain(distance):
    assert distance(note(gain=-20.0), note()) == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("distance", DISTANCES)
def test_the_noise_of_a_recording_is_no_distance(distance):
    """Noise that lies over most of the tones later on; without its level, it would count."""
    noisy = {is_known: distance(note(), note(is_recording=is_known, noise=0.02)) for is_known in (True, False)}
    assert noisy[True] < 1.0
    assert distance is attack_distance or noisy[False] > 5.0


def test_the_noise_is_read_before_the_fade():
    audio = strike(noise=0.01)
    alone = band_powers(0.01 * np.random.default_rng(2).standard_normal(audio.shape), RATE).mean(axis=0)
    assert 10 * np.log10(noise_powers(audio, RATE)[8:26] / alone[8:26]) == pytest.approx(np.zeros(18), abs=1.5)


def test_channels_that_are_opposite_are_as_loud_as_those_that_are_equal():
    one = strike()[:, :1]
    equal, opposite = (Note((np.concatenate([one, sign * one], axis=1), RATE), KEY) for sign in (1, -1))
    assert level_and_brightness(opposite, equal)[0] == pytest.approx(0.0, abs=1e-9)
    assert spectral_distance(opposite, equal) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.hard
def test_a_sound_6_db_louder_or_brighter_is_so_in_noise():
    recorded = note(is_recording=True, noise=0.003)
    assert level_and_brightness(note(gain=6.0), recorded) == pytest.approx((6.0, 0.0), abs=0.2)
    level, brighter = level_and_brightness(note(high=6.0), recorded)
    assert level + brighter == pytest.approx(6.0, abs=0.3)  # of what is above 2 kHz


@pytest.mark.hard
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_decay_twice_as_fast_or_slow_is_off_by_two_in_every_octave(factor):
    recorded = {10: note(is_recording=True, noise=1e-4, fall=20.0)}
    (result,) = compare_layers(recorded, {}, {"it": {10: note(fall=factor * 20.0)}}, 10)
    heard = np.isfinite(result.decays)
    assert list(OCTAVES[heard]) == [125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0]
    assert np.exp(result.decays[heard]) == pytest.approx(np.full(7, factor), rel=0.03)
    octaves = [octave for octave in octave_means(5 * [result]) if octave.notes]
    assert [octave.factor for octave in octaves] == pytest.approx(len(octaves) * [2.0], rel=0.03)


def test_channels_correlate_as_much_as_they_share():
    rng = np.random.default_rng(3)
    common, left, right = (rng.standard_normal(2 * RATE) for _ in range(3))
    for share, expected in ((1.0, 1.0), (0.0, 0.0), (math.sqrt(0.5), 0.5)):
        rest = math.sqrt(1 - share**2)
        sound = np.stack([share * common + rest * left, share * common + rest * right], axis=1)
        assert channel_correlation(sound, RATE, 440.0)[3:] == pytest.approx(np.full(5, expected), abs=0.12)
    assert np.isnan(channel_correlation(sound, RATE, 440.0)[:2]).all()  # octaves below the note
    assert np.isnan(channel_correlation(sound[:, :1], RATE, 440.0)).all()


@pytest.mark.hard
def test_natural_variation_is_the_nearest_layer_and_the_neighbour():
    recorded = {layer: note(is_recording=True, noise=1e-4, high=layer) for layer in (2, 4, 16)}
    results = list(compare_layers(recorded, {4: recorded[4]}, {}, 10))
    of = {(r.source, r.layer): r for r in results}
    assert of[NEIGHBOUR, 4].bands == pytest.approx(0.0, abs=0.01)
    assert len(of) == 4
    assert of[ANOTHER_LAYER, 2].bands == pytest.approx(of[ANOTHER_LAYER, 4].bands, rel=0.3)
    assert of[ANOTHER_LAYER, 16].bands > 3 * of[ANOTHER_LAYER, 2].bands


@pytest.mark.hard
def test_levels_over_layers_and_over_keys_are_judged_apart():
    """A gain is nobody's error; a layer 6 dB too loud is, and so are keys 2 dB off either way."""
    recorded = {layer: note(is_recording=True, noise=1e-4) for layer in (4, 10)}
    results = []
    for off in (-2.0, 2.0):
        sources = {"it": {4: note(gain=30.0 + off), 10: note(gain=36.0 + off)}}
        results += [r for r in compare_layers(recorded, {}, sources, 2) if r.source == "it"]
    assert level_errors(results, (4, 10)) == pytest.approx([-3.0, 3.0], abs=0.05)
    assert unevenness(results) == pytest.approx(2.0, abs=0.05)


def test_layers_are_struck_in_the_middle_of_the_velocities_that_play_them():
    assert [layer_velocity(layer) for layer in (1, 2, 4, 6, 10, 16)] == [13, 30, 40, 48, 76, 124]


@pytest.mark.skipif(not peers.find_fonts(), reason="no fluidsynth, or no sound fonts")
def test_a_sampled_piano_plays_each_note_as_asked(tmp_path):
    font = min(peers.find_fonts().values(), key=lambda path: path.stat().st_size)
    play = peers.play_font(font, [(60, 2, 0.5), (60, 16, 0.5), (72, 10, 1.0)], tmp_path)
    soft, loud, high = (play(*which)[0] for which in ((60, 2), (60, 16), (72, 10)))
    assert soft.shape == loud.shape == (peers.RATE // 2, 2) and len(high) == peers.RATE
    assert np.abs(loud).max() > 4 * np.abs(soft).max() > 0
    assert np.abs(high[: peers.RATE // 50]).max() > 0.01 * np.abs(high).max()
    assert play(61, 10) is None
