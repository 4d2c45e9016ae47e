"""Free bars move as a whole too: on their cords, and under a mallet."""

import math

import numpy as np
import pytest
import scipy

import engine
from bench.scenes.small import scene
from engine.assembly.build import build
from engine.bodies import Bar
from engine.offline.simulation import Simulation

BAR = {"name": "b", "kind": "bar", "length": 0.52, "mass": 0.24, "frequency": 130.81, "ratios": [1.0, 3.99, 10.65]}
MALLET = {"name": "m", "kind": "mass", "mass": 0.02, "displacement": -1e-4, "velocity": 2.0}
TOUCH = {"body": "m", "on": "b", "on_at": 0.5, "stiffness": 1e9, "exponent": 2.5}


def test_it_bounces_and_rocks_on_cords_at_its_nodes():
    """Two springs of k at the nodes of the first partial hold a rigid bar: ω² = 2k/m, and 2k·d²/(m·L²/12) of the turn,
    d = 0.2758·L from the middle."""
    body = Bar(**BAR | {"cords": {"frequency": 12.0, "t60": 0.4}})
    modal = body.modal_body(20_000.0)
    hertz, k = modal.omega[-2:] / (2 * math.pi), 0.24 * (2 * math.pi * 12.0) ** 2 / 2
    turn = math.sqrt(2 * k * (0.52 * (0.5 - 0.22416)) ** 2 / (0.24 * 0.52**2 / 12)) / (2 * math.pi)
    np.testing.assert_allclose(hertz, [12.0, turn], rtol=1e-5)
    np.testing.assert_allclose(modal.shape(0.5)[-2:], [1 / math.sqrt(0.24), 0.0], atol=1e-15)
    np.testing.assert_allclose(modal.shape(1.0)[-1], math.sqrt(3 / 0.24), rtol=1e-15)


def test_cords_are_nearly_springs_at_the_nodes():
    """Supports at the nodes, of the same stiffness, give the same pitches of the whole bar and its partials."""
    k = 0.24 * (2 * math.pi * 12.0) ** 2 / 2
    held = BAR | {"support": [{"at": 0.22416, "stiffness": k}, {"at": 0.77584, "stiffness": k}]}
    pickup = [{"body": "b", "at": 0.1, "quantity": "displacement"}]
    event = {"body": "b", "at": 0.35, "kind": "pulse", "amplitude": 5.0, "duration": 1e-3}
    cords = BAR | {"cords": {"frequency": 12.0, "t60": 1e6}}
    a, b = (engine.render(scene([x], pickup=pickup, force=[event], seconds=0.3)).audio[:, 0] for x in (held, cords))
    assert np.sqrt(np.mean((a - b) ** 2)) < 0.01 * np.sqrt(np.mean(a**2))


@pytest.mark.hard
def test_a_mallet_rebounds_from_a_free_bar():
    """Against SciPy's DOP853 of the same bar; one that could not move as a whole would throw it back faster."""
    result = engine.render(
        scene([BAR | {"t60": [1e6]}, MALLET], contact=[TOUCH], pickup=[{"body": "m"}], seconds=0.02),
        samplerate=88_200,
        substeps=4,
    )
    body = Bar(**BAR | {"t60": [1e6]}).modal_body(20_000.0)
    phi, omega = body.shape(0.5), body.omega
    n = omega.size

    def rebound(modes) -> float:
        def slope(t, y):
            q, p = y[:n], y[n : 2 * n]
            force = 1e9 * max(0.0, y[-2] - phi[modes] @ q[modes]) ** 2.5
            push = np.zeros(n)
            push[modes] = phi[modes] * force
            return np.concatenate([p, push - omega**2 * q, [y[-1], -force / 0.02]])

        start = np.concatenate([np.zeros(2 * n), [-1e-4, 2.0]])
        return float(
            scipy.integrate.solve_ivp(slope, (0, 0.02), start, method="DOP853", rtol=1e-10, atol=1e-14).y[-1, -1]
        )

    free, held = rebound(np.arange(n)), rebound(np.arange(n - 2))
    assert result.audio[-1, 0] == pytest.approx(free, rel=2e-3)
    assert held / free > 1.15


def test_the_partials_of_a_struck_bar_are_those_of_a_free_one():
    """Energies of its three partials after the blow, against DOP853: within 0.1 dB."""
    touch = TOUCH | {"stiffness": 1e10, "on_at": 0.4}
    told = scene([BAR | {"t60": [1e6]}, MALLET], contact=[touch], pickup=[{"body": "m"}], seconds=0.02)
    model, state, layout = build(told, 88_200, told.accuracy.replace(substeps=4))
    Simulation(model, state).render_block(np.zeros((1764, 1)))
    body = layout.modal_bodies[0]
    phi, omega, bar = body.shape(0.4), body.omega, layout.modes.in_island[0]
    n = omega.size

    def slope(t, y):
        force = 1e10 * max(0.0, y[-2] - phi @ y[:n]) ** 2.5
        return np.concatenate([y[n : 2 * n], phi * force - omega**2 * y[:n], [y[-1], -force / 0.02]])

    start = np.concatenate([np.zeros(2 * n), [-1e-4, 2.0]])
    end = scipy.integrate.solve_ivp(slope, (0, 0.02), start, method="DOP853", rtol=1e-10, atol=1e-14).y[:, -1]
    own, wanted = (p**2 + (omega * q) ** 2 for q, p in ((state.q[bar], state.p[bar]), (end[:n], end[n : 2 * n])))
    np.testing.assert_allclose(10 * np.log10(own[:3] / wanted[:3]), 0.0, atol=0.1)


def test_cords_hold_only_a_free_bar():
    with pytest.raises(ValueError, match='cords under a bar that is clamped; a bar with ends = "free"'):
        scene([BAR | {"ends": "clamped", "cords": {}}], pickup=[{"body": "b", "at": 0.1}])
