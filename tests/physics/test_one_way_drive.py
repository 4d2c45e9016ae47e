"""Strings that drive a board one way: the board hears the force on their ends, and does not act back."""

import math

import numpy as np
import pytest
from conftest import mostly_hard

import engine
from bench.scenes.small import scene
from engine.assembly.build import build
from engine.bodies import Plate, String
from engine.offline.simulation import Simulation

STRING = {
    "name": "s",
    "kind": "string",
    "length": 0.62,
    "mass": 3.93e-3,
    "frequency": 261.6,
    "sigma0": 2.0,
    "modes": 40,
}
PULLED = STRING | {"displacement": {"kind": "triangle", "at": 0.2, "amplitude": 1e-3}}
BOARD = {"name": "b", "kind": "plate", "size": [0.8, 0.5], "frequency": 70.0, "area_density": 4.0, "modes": 50}
BOARD |= {"decay": {"kind": "loss_factor", "eta": 0.02}}
END = {"kind": "end", "body": "s", "at": 1.0, "on": "b", "on_at": [0.3, 0.4], "one_way": True}
SPRING = {"body": "b", "at": [0.1, 0.1], "on": "t", "on_at": 0.4, "stiffness": 1e3}
HEARD = [{"body": "b", "at": [0.45, 0.55], "quantity": "velocity"}]


def driven(bodies, ends, **more) -> engine.Scene:
    return scene(bodies, connection=ends, pickup=HEARD, **more)


@pytest.mark.hard
def test_the_board_moves_as_the_force_on_the_end_makes_it():
    """Against exact solutions of its modes: a string of known motion, -T·y'(L, t), on damped oscillators."""
    rate, n = 44_100, 8820
    own = engine.render(driven([PULLED, BOARD], [END], seconds=0.2)).audio[:, 0]
    string, board = (body.modal_body(21_609.0) for body in (String(**PULLED), Plate(**BOARD)))
    phi, heard, time = board.shape([0.3, 0.4]), board.shape([0.45, 0.55]), np.arange(n) / rate
    beta, tension = np.arange(1, 41) * math.pi / 0.62, (2 * 0.62 * 261.6) ** 2 * 3.93e-3 / 0.62
    pull = -tension * math.sqrt(2 / 3.93e-3) * beta * np.cos(beta * 0.62) * string.q
    pole = -string.sigma + 1j * np.sqrt(string.omega**2 - string.sigma**2)
    weight = pull * (1 - 1j * string.sigma / pole.imag)  # q(0) = 1, and at rest
    velocity = np.zeros(n)
    for p, f, sigma, omega in zip(phi, heard, board.sigma, board.omega, strict=True):
        gain = p / (pole**2 + 2 * sigma * pole + omega**2)  # q'' + 2σq' + ω²q = p·F
        mode = -sigma + 1j * math.sqrt(omega**2 - sigma**2)
        at0, speed0 = np.sum(np.real(weight * gain)), np.sum(np.real(weight * gain * pole))
        a, b = -at0, (-speed0 - sigma * at0) / mode.imag
        forced = np.real(np.exp(np.outer(time, pole)) @ (weight * gain * pole))
        decay = np.exp(-sigma * time)
        c, s = np.cos(mode.imag * time), np.sin(mode.imag * time)
        velocity += f * (forced + decay * ((b * mode.imag - sigma * a) * c - (a * mode.imag + sigma * b) * s))
    late = velocity[:-1]  # the force comes one sample late
    assert np.linalg.norm(own[1:] - late) < 0.02 * np.linalg.norm(late)


def test_a_heavy_board_hardly_acts_back():
    """The heavier the board, the nearer to the string that rides on it; by its mass."""
    errors = []
    for factor in (10.0, 100.0):
        board = BOARD | {"area_density": 4.0 * factor}
        both = engine.render(driven([PULLED, board], [END | {"one_way": False}], seconds=0.2)).audio[:, 0]
        one = engine.render(driven([PULLED, board], [END], seconds=0.2)).audio[:, 0]
        errors.append(np.linalg.norm(one[1:] - both[:-1]) / np.linalg.norm(both))
    assert errors[1] < 0.12
    assert errors[1] < 0.3 * errors[0]


@pytest.mark.parametrize("order", [2, 4])
def test_its_work_is_booked_as_supplied(order):
    result = engine.render(driven([PULLED, BOARD], [END], seconds=1.0), order=order)
    energy = result.stats.energy
    assert energy.error_max < 1e-13
    assert energy.supplied > 0.0
    alone = engine.render(scene([PULLED], pickup=[{"body": "s", "at": 0.3}], seconds=1.0))
    audio = engine.render(
        scene([PULLED, BOARD], connection=[END], pickup=[{"body": "s", "at": 0.3}], seconds=1.0)
    ).audio
    np.testing.assert_array_equal(audio, alone.audio)  # the string does not know of the board


SETS = {
    "one": ([PULLED, BOARD], [END]),
    "board first": ([BOARD, PULLED], [END]),
    "two at one place, one elsewhere": (
        [BOARD, PULLED, PULLED | {"name": "t"}, PULLED | {"name": "u", "frequency": 300.0}],
        [END, END | {"body": "t", "at": 0.0}, END | {"body": "u", "on_at": [0.6, 0.2]}],
    ),
    "a chain": (
        [BOARD | {"name": "c"}, PULLED | {"name": "t"}, BOARD, PULLED],
        [
            END,
            END | {"body": "t", "on": "c"},
            {"body": "b", "at": [0.1, 0.1], "on": "t", "on_at": 0.4, "stiffness": 1e3},
        ],
    ),
}


@pytest.mark.slow_but("a chain")
@pytest.mark.parametrize("name", mostly_hard(list(SETS)))
def test_blocks_and_kernels_make_no_difference(name):
    """Special and general kernel, one core and two, blocks of any size: the same samples."""
    told = driven(*SETS[name], seconds=0.1)
    first = engine.render(told, kernel="special", cores=1).audio
    assert np.abs(first).max() > 0.0
    np.testing.assert_array_equal(engine.render(told, kernel="general", cores=2).audio, first)
    for size in (1, 63, 1500):
        model, state, _ = build(told, 44_100)
        simulation, parts = Simulation(model, state), []
        while sum(map(len, parts)) < 4410:
            block = np.zeros((size, 1))
            simulation.render_block(block)
            parts.append(block)
        np.testing.assert_array_equal(np.concatenate(parts)[:4410], first[:4410])


def test_a_string_that_sleeps_drives_nothing():
    """After it has died the board rings out, and stays still."""
    board = BOARD | {"decay": {"kind": "list", "sigma": [30.0]}}
    result = engine.render(driven([PULLED | {"sigma0": 60.0}, board], [END], seconds=2.0))
    audio = result.audio[:, 0]
    assert np.abs(audio[-1000:]).max() < 1e-15 * np.abs(audio).max()
    assert 0.4 < result.stats.activity.asleep < 0.5  # the string, of two islands


def test_a_struck_string_drives_the_board():
    hammer = {"name": "h", "kind": "mass", "mass": 3e-3, "displacement": -1e-4, "velocity": 2.0}
    felt = [{"body": "h", "on": "s", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5, "loss": 0.02}]
    result = engine.render(driven([STRING, BOARD, hammer], [END], contact=felt, seconds=0.5))
    assert result.stats.energy.error_max < 1e-13
    assert np.abs(result.audio).max() > 1e-3


def test_a_circle_of_drives_is_refused():
    joined = [END, {"body": "b", "at": [0.1, 0.1], "on": "s", "on_at": 0.4, "stiffness": 1e3}]
    with pytest.raises(engine.BuildError, match='"s" drives "b", which acts back on it through other bodies'):
        engine.render(driven([PULLED, BOARD], joined, seconds=0.1))
