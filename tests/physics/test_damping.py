"""Heavily damped bodies move as the closed forms say; a flat energy is no proof of that."""

import math

import numpy as np
import pytest

import engine
from bench.scenes.small import barrier, mass, oscillator, scene
from engine.faults import BuildError

RATES = (8_000, 44_100, 192_000)
DAMPINGS = (0.0, 1e-6, 1e-3, 1.0, 60.0, 1e3, 1e4, 1e5, 1e6)  # γ, 1/s
SECONDS = 0.05
RATE = 44_100


def moved(gamma: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far a mass of 1 kg has come per velocity at first, s, and per constant force, m/N:
    A(t) = (1 - e^(-γt))/γ and C(t) = (t - A)/γ."""
    x = gamma * t
    small = x < 1e-4
    coasting = np.where(small, t * (1 - x / 2 + x**2 / 6), -np.expm1(-x) / np.where(gamma, gamma, 1.0))
    pushed = np.where(small, t**2 * (0.5 - x / 6 + x**2 / 24), (t - coasting) / np.where(gamma, gamma, 1.0))
    return coasting, pushed


def traced(body: dict, samplerate: int, **more) -> dict:
    more = {"accuracy": {"silence": -math.inf}} | more  # asleep, it would stand still
    rendering = engine.render(scene([body], **more), seconds=SECONDS, samplerate=samplerate, trace=True)
    assert rendering.stats["newton"]["unconverged"] == 0
    energy = rendering.stats["energy"]
    flow = 1.0 + energy["dissipated"] / np.max(rendering.trace["kinetic"] + np.abs(rendering.trace["potential"]))
    assert energy["error_max"] <= 2e-12 * flow  # what passes through is far more than what is ever held
    return rendering.trace


@pytest.mark.parametrize("samplerate", RATES)
@pytest.mark.parametrize("gamma", DAMPINGS)
@pytest.mark.parametrize("substeps", [1, pytest.param(3, marks=pytest.mark.hard)])
def test_a_damped_mass_moves_as_the_closed_form(gamma, samplerate, substeps):
    """Coasting, under its weight, and pushed by a force: to 1e-9 of how far it comes."""
    far = {"barrier": 1e5, "stiffness": 1.0, "exponent": 7.7}  # one kernel for all
    options = {"contact": [barrier(**far)], "accuracy": {"substeps": substeps, "silence": -math.inf}}
    push = {"body": "body", "kind": "constant", "amplitude": 3.0}
    idle = push | {"start": 1.0}
    cases = [
        ({"velocity": 2.0}, 1e-300, idle, lambda a, c: 2.0 * a),
        ({}, 9.81, idle, lambda a, c: -9.81 * c),
        ({}, 1e-300, push, lambda a, c: 3.0 * c),
    ]
    for begin, gravity, force, expected in cases:
        trace = traced(mass(damping_rate=gamma, **begin), samplerate, gravity=gravity, force=[force], **options)
        wanted = expected(*moved(gamma, trace["time"]))
        assert np.max(np.abs(trace["displacement"][:, 0] - wanted)) <= 1e-9 * np.max(np.abs(wanted))


@pytest.mark.parametrize("samplerate", RATES)
@pytest.mark.parametrize("gamma", [1e2, 1e4, 1e6])
def test_a_damped_mass_rests_on_a_stop_as_its_weight_says(gamma, samplerate):
    """Pressed on a stop of stiffness k with k·C = 0.1 it comes to rest at m·g/k, to 1 %; where it creeps there, along
    the closed form."""
    h = 1.0 / samplerate
    k = 0.1 / float(moved(gamma, np.array([h]))[1][0])
    stop = {"barrier": 0.0, "side": "below", "stiffness": k, "exponent": 1.0}
    far = {"barrier": 1e5, "stiffness": 1.0, "exponent": 7.7}
    body, contacts = mass(damping_rate=gamma), [barrier(**stop), barrier(**far)]
    rendering = engine.render(
        scene([body], gravity=9.81, contact=contacts),
        seconds=max(20 / gamma, 20 * gamma / k),
        samplerate=samplerate,
        trace=True,
    )
    depth, t = rendering.trace["compression"][:, 0], rendering.trace["time"]
    assert depth[-1] == pytest.approx(9.81 / k, rel=0.01)
    if gamma**2 > 4 * k:
        slow = math.sqrt(gamma**2 / 4 - k)
        fast, late = -gamma / 2 - slow, -k / (gamma / 2 + slow)  # roots of s² + γ·s + k
        wanted = 9.81 / k * (1 - (fast * np.exp(late * t) - late * np.exp(fast * t)) / (fast - late))
        assert np.max(np.abs(depth - wanted)) <= 0.01 * np.max(wanted)
    assert rendering.stats["energy"]["error_max"] <= 1e-11


@pytest.mark.parametrize("samplerate", RATES)
@pytest.mark.parametrize("sigma", [1e-3, 1e2, 3e3, 1e5, 5e5])
@pytest.mark.parametrize("frequency", [1e-3, 10.0, 440.0, 1000.0])
def test_a_damped_oscillator_moves_as_the_closed_form(frequency, sigma, samplerate):
    """Released from rest, under- and overdamped: within 5e-3 where loss is apart from the core, else to 1e-9."""
    omega, t = 2 * math.pi * frequency, np.arange(round(SECONDS * samplerate)) / samplerate
    far = {"barrier": 1e5, "stiffness": 1.0, "exponent": 7.7}
    body = oscillator(frequency=frequency, damping_rate=2 * sigma, displacement=1e-3)
    idle = {"body": "body", "kind": "constant", "amplitude": 3.0, "start": 1.0}
    trace = traced(body, samplerate, contact=[barrier(**far)], gravity=1e-300, force=[idle])
    slow = np.sqrt(complex(sigma**2 - omega**2))
    late = omega**2 / (sigma + slow)
    fast = sigma + slow
    wanted = 1e-3 * np.real((fast * np.exp(-late * t) - late * np.exp(-fast * t)) / (fast - late))
    error = 1e-9 if sigma / samplerate > 0.05 else 5e-3
    assert np.max(np.abs(trace["displacement"][:, 0] - wanted)) <= error * 1e-3


def test_heavy_damping_is_refused_where_steps_go_back_in_time():
    with pytest.raises(BuildError, match=r"decay rates up to 6615 1/s \(1e\+04 here\)"):
        engine.render(scene([mass(damping_rate=2e4)]), seconds=0.01, order=4)


@pytest.mark.parametrize("frequency, sigma", [(262.0, 10.0), (262.0, 1e3), (2620.0, 1e3), (262.0, 1e4)])
def test_a_damper_of_the_score_damps_as_a_loss_of_the_body(frequency, sigma):
    """Let down on a vibration at its peak: the closed form of a damped oscillator is met as well, but for a term of
    second order in the step, by displacements and velocities."""
    omega, errors, errors_of_velocity = 2 * math.pi * frequency, [], []
    damper = {"time": 0.0, "kind": "damp", "body": "body", "sigma": sigma}
    for own, score in ((2 * sigma, []), (0.0, [damper])):
        body = oscillator(frequency=frequency, displacement=1e-3, damping_rate=own)
        rendering = engine.render(scene([body], event=score), seconds=0.02, trace=True)
        slow, t = np.sqrt(complex(sigma**2 - omega**2)), rendering.trace["time"]
        late, fast = omega**2 / (sigma + slow), sigma + slow
        wanted = 1e-3 * np.real((fast * np.exp(-late * t) - late * np.exp(-fast * t)) / (fast - late))
        errors.append(np.max(np.abs(rendering.trace["displacement"][:, 0] - wanted)) / 1e-3)
        speed = 1e-3 * np.real(fast * late * (np.exp(-fast * t) - np.exp(-late * t)) / (fast - late))
        errors_of_velocity.append(np.max(np.abs(rendering.trace["velocity"][:, 0] - speed)) / (1e-3 * omega))
        assert rendering.stats["energy"]["error_max"] <= 1e-12
    assert errors[1] <= 1.1 * errors[0] + (sigma / RATE) ** 2 / 4
    assert errors_of_velocity[1] <= 1.1 * errors_of_velocity[0] + 5 * (sigma / RATE) ** 2


@pytest.mark.parametrize("frequency", [0.0, 1e-300, 1e-160, 1e-152])
def test_what_hardly_turns_back_flies_on(frequency):
    """A frequency whose square underflows is none."""
    rendering = engine.render(scene([oscillator(frequency=frequency, velocity=1.0)]), seconds=0.01, trace=True)
    assert rendering.trace["displacement"][-1, 0] == pytest.approx(rendering.trace["time"][-1], rel=1e-12)
