"""The paper's systems do what its figures show."""

import itertools

import numpy as np
import pytest
import scipy
from conftest import mostly_hard

import engine
from bench.paper import equations

SHORTER = {"5": 0.5, "7": 1.2}  # s: a bounce, and two; the figures show more, and take longer
FOLLOWED = {"7": 1e-11}  # relative to the largest displacement; a bounce makes a difference before it larger


@pytest.mark.parametrize("scheme", ["exact", "fdh"])
def test_the_bouncing_ball_returns_to_its_height(patch, scheme):
    """Fig. 5: 0.2 m, bounce after bounce."""
    place = engine.render(patch("bouncing_ball"), scheme=scheme, trace=True).trace["displacement"][:, 0]
    tops = place[1:-1][(place[1:-1] > place[:-2]) & (place[1:-1] >= place[2:]) & (place[1:-1] > 0)]
    assert tops.size == 3
    np.testing.assert_allclose(tops, 0.2, atol=2e-9)  # a top falls between samples: g·h²/8 lower at most


def test_the_oscillator_is_repelled(patch):
    """Fig. 6: it swings between -2 mm and where spring and barrier hold the energy of the start."""
    place = engine.render(patch("repelled_oscillator"), seconds=0.1, trace=True).trace["displacement"][:, 0]
    stiffness = (2 * np.pi * 440) ** 2
    stored = lambda y: stiffness * y**2 / 2 + 2.5e10 / 3 * (y + 0.93e-3) ** 3
    turn = scipy.optimize.brentq(lambda y: stored(y) - stiffness * 2e-3**2 / 2, -0.93e-3, 1e-3)
    assert place.min() == pytest.approx(-2e-3, rel=1e-3)
    assert place.max() == pytest.approx(turn, abs=2e-6)
    assert np.count_nonzero((place[:-1] < -0.93e-3) & (place[1:] >= -0.93e-3)) > 44  # more often than 440 Hz


def test_the_driven_ball_comes_to_rest(patch):
    """Sec. 3.3: 20 s of the driven, damped ball decay to zero, without limit cycles."""
    trace = engine.render(patch("driven_ball"), seconds=20, trace=True).trace
    speed = np.abs(trace["velocity"][:, 0]).reshape(20, -1).max(axis=1)
    assert speed[0] > 3.0
    assert np.all(np.diff(speed) < 0)
    assert speed[-1] < 1e-6 * speed[0]
    rest = (9.81 / 1e11) ** (1 / 4)
    assert trace["displacement"][-1, 0] == pytest.approx(-rest, rel=1e-6)


def test_nonlinear_damping_lowers_every_bounce(patch):
    """Eq. 41: each bounce of the lossy ball is lower than the last, and lossless flight between."""
    trace = engine.render(patch("lossy_bounce"), trace=True).trace
    place, force = trace["displacement"][:, 0], trace["force"][:, 0]
    landings = np.flatnonzero((force[:-1] == 0) & (force[1:] > 0))
    tops = [place[a:b].max() for a, b in itertools.pairwise(landings)]
    assert len(tops) >= 5
    assert np.all(np.diff(tops) < 0)
    flight = slice(landings[0] + 40, landings[1] - 2)
    assert np.ptp(trace["total"][flight]) < 1e-15


@pytest.mark.parametrize("figure", mostly_hard(equations.CASES, *list(equations.CASES)[:2]))
def test_the_engine_follows_the_equations_of_the_paper(figure):
    """Solved in fifty digits as they are printed: the displacement of every sample, and the energy, is the same."""
    what, seconds = equations.CASES[figure]
    difference, error, drift = equations.compare(what, SHORTER.get(figure, seconds))
    assert difference < FOLLOWED.get(figure, 2e-14) and error < 5e-14
    assert figure == "7" or drift < 1e-30  # without loss and force, the equations conserve their energy (eq. 16)
