"""What pickups hear: places, means of places, pressure of a sheet, and where it is panned."""

import math

import numpy as np
import pytest
import scipy

import engine
from bench.scenes.small import scene

DRUM = {
    "name": "d",
    "kind": "membrane",
    "area_density": 0.3,
    "frequency": 100.0,
    "radius": 0.2,
    "modes": 60,
    "sigma0": 2.0,
}
PLATE = {"name": "d", "kind": "plate", "area_density": 7.8, "frequency": 80.0, "size": [0.5, 0.3], "modes": 40}
STRING = {"name": "d", "kind": "string", "length": 0.6, "mass": 4e-3, "frequency": 200.0, "modes": 30}
HIT = {"kind": "half_sine", "body": "d", "at": [0.6, 0.45], "amplitude": 20.0, "duration": 1e-3}


def heard(body, *pickups, force=HIT, rate=44_100, seconds=0.05) -> np.ndarray:
    numbered = [{"channel": n} | p | {"body": "d"} for n, p in enumerate(pickups, 1)]
    return engine.render(scene([body], pickup=numbered, force=[force], seconds=seconds), samplerate=rate).audio


@pytest.mark.parametrize("body", [DRUM, PLATE], ids=["membrane", "plate"])
def test_a_sheet_is_heard_by_its_acceleration(body):
    at = {"at": [0.3, 0.4]}
    audio = heard(body, at, at | {"quantity": "acceleration"}, at | {"quantity": "velocity"})
    np.testing.assert_array_equal(audio[:, 0], audio[:, 1])
    np.testing.assert_allclose(np.diff(audio[:, 2]) * 44_100, audio[1:, 0], rtol=1e-9, atol=1e-6)


def test_a_string_is_heard_by_its_velocity():
    audio = heard(STRING, {"at": 0.3}, {"at": 0.3, "quantity": "velocity"}, force=HIT | {"at": 0.2})
    np.testing.assert_array_equal(audio[:, 0], audio[:, 1])


@pytest.mark.parametrize(("frequency", "decibels"), [(5000.0, -0.18), (10_000.0, -0.75)])
def test_an_acceleration_is_the_mean_over_a_step(frequency, decibels):
    """sin x / x of ω times the velocity, x = πf/fs."""
    body = {"name": "o", "kind": "oscillator", "mass": 1e-3, "frequency": frequency, "velocity": 1.0}
    pickups = [{"body": "o", "quantity": q, "channel": n} for n, q in ((1, "velocity"), (2, "acceleration"))]
    velocity, acceleration = engine.render(engine.load({"body": [body], "pickup": pickups}), 0.2).audio[10:].std(axis=0)
    share = 20 * np.log10(acceleration / (2 * np.pi * frequency * velocity))
    x = np.pi * frequency / 44_100
    assert share == pytest.approx(20 * np.log10(np.sin(x) / x), abs=0.005)
    assert share == pytest.approx(decibels, abs=0.01)


def test_a_list_of_places_is_heard_as_their_mean():
    places = [[0.3, 0.4], [0.5, 0.5], [0.66, 0.31]]
    audio = heard(DRUM, {"at": places}, *({"at": place} for place in places))
    np.testing.assert_allclose(audio[:, 0], audio[:, 1:].mean(axis=1), atol=1e-9 * np.abs(audio).max())


@pytest.mark.parametrize("pan", [-1.0, -0.4, 0.0, 0.7, 1.0])
def test_a_pan_keeps_the_power(pan):
    audio = heard(DRUM, {"at": [0.3, 0.4]})[:, 0]
    panned = scene([DRUM], pickup=[{"body": "d", "at": [0.3, 0.4], "pan": pan}], force=[HIT], seconds=0.05)
    left, right = engine.render(panned).audio.T
    np.testing.assert_allclose(np.hypot(left, right), np.abs(audio), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        right * math.cos((pan + 1) * math.pi / 4), left * math.sin((pan + 1) * math.pi / 4), atol=1e-9
    )


@pytest.mark.hard
def test_the_pressure_of_a_drum_is_rayleighs():
    """Far off, p = ρ/(2πr)·d²V/dt²; of the first mode of a circle V = 2πa²·J₁(z)/z times the amplitude of its middle,
    and no mode but the symmetrical ones moves any air."""
    z = float(scipy.special.jn_zeros(0, 1)[0])
    begin = {"kind": "mode", "number": 1, "amplitude": 1e-4}
    body = DRUM | {"displacement": begin, "sigma0": 0.0}
    pickups = [{"body": "d", "quantity": "pressure", "distance": 2.0}, {"body": "d", "at": [0.5, 0.5], "channel": 2}]
    audio = engine.render(scene([body], pickup=pickups, seconds=0.05)).audio[1:]
    j1 = 0.5191474972894669  # J₁ at that zero
    volume = 2 * math.pi * 0.2**2 * j1 / z
    np.testing.assert_allclose(audio[:, 0], 1.204 / (2 * math.pi * 2.0) * volume * audio[:, 1], rtol=2e-3, atol=1e-6)
    still = DRUM | {"displacement": begin | {"number": 2}, "sigma0": 0.0}
    silent = engine.render(scene([still], pickup=pickups, seconds=0.05)).audio
    assert np.abs(silent[:, 0]).max() < 1e-9 * np.abs(audio[:, 0]).max()


def test_pressure_summed_over_places_approaches_that_of_the_sheet():
    grid = [[(i + 0.5) / 22, (j + 0.5) / 22] for i in range(22) for j in range(22)]
    audio = heard(PLATE, {"quantity": "pressure"}, {"quantity": "pressure", "at": grid})
    assert np.abs(audio[:, 0] - audio[:, 1]).max() < 0.02 * np.abs(audio[:, 0]).max()


def test_a_plate_moves_air_by_its_odd_modes():
    """∬ sin(mπx)·sin(nπy) = 4·a·b/(mnπ²) for odd m and n, else 0."""
    plate = engine.Scene.model_validate({"body": [PLATE], "pickup": [{"body": "d", "at": [0.2, 0.3]}]}).body[0]
    modal = plate.modal_body(20_000.0)
    row = plate.volume_row(modal)
    scale = 2 / math.sqrt(7.8 * 0.15)
    m, n = (np.array(v) for v in zip(*[(m, n) for m in range(1, 30) for n in range(1, 30)], strict=True))
    order = np.argsort((m / 0.5) ** 2 + (n / 0.3) ** 2)[:40]
    wanted = np.where((m * n) % 2 == 1, scale * 4 * 0.15 / (m * n * math.pi**2), 0.0)[order]
    np.testing.assert_allclose(row, wanted, atol=1e-12)
