"""Laws of loss by their names: the decay rates they give, and the sound that dies accordingly."""

import math

import numpy as np
import pytest

import engine
from bench.scenes.small import scene
from engine.bodies import String
from engine.bodies.body import TO_60_DB

L, MASS, F1 = 0.62, 3.93e-3, 261.6
# by kind, its numbers, and σ of frequency f and wave number β as its source has it
LAWS = {
    "bilbao": ({"sigma0": 0.8, "sigma1": 5e-3}, lambda f, beta: 0.8 + 5e-3 * beta**2),
    "van_walstijn": (
        {"sigma0": 0.6, "sigma1": 6.5e-3, "sigma3": 5e-6},
        lambda f, beta: 0.6 + 6.5e-3 * beta + 5e-6 * beta**3,
    ),
    "chaigne_askenfelt": ({"b1": 0.5, "b3": 6.25e-9}, lambda f, beta: 0.5 + 6.25e-9 * (2 * math.pi * f) ** 2),
    "linear": ({"a": 0.3, "b": 2e-3}, lambda f, beta: 0.3 + 2e-3 * f),
    "loss_factor": ({"eta": 1e-3}, lambda f, beta: math.pi * f * 1e-3),
}


def string(decay) -> dict:
    body = {"name": "s", "kind": "string", "length": L, "mass": MASS, "frequency": F1, "inharmonicity": 3.8e-4}
    return body | {"decay": decay}


@pytest.mark.parametrize("kind", LAWS)
def test_each_mode_decays_as_its_law_says(kind):
    """A string in one mode falls by exp(-σt), as the source's formula has it."""
    numbers, sigma = LAWS[kind]
    for n in (1, 4, 15):
        begin = {"kind": "mode", "number": n, "amplitude": 1e-3}
        body = string({"kind": kind} | numbers) | {"displacement": begin}
        f = n * F1 / math.sqrt(1 + 3.8e-4) * math.sqrt(1 + 3.8e-4 * n**2)
        result = engine.render(scene([body], pickup=[{"body": "s", "at": 0.31}], seconds=0.4))
        energy = result.stats.energy
        left = energy.final / energy.initial
        assert -math.log(left) / 2 / 0.4 == pytest.approx(sigma(f, n * math.pi / L), rel=2e-3)


def test_a_list_is_of_the_modes_and_its_last_holds_on():
    own = String(**string({"kind": "list", "sigma": [1.0, 2.0, 5.0]})).modal_body(21_609.0)
    np.testing.assert_array_equal(own.sigma[:4], [1, 2, 5, 5])
    assert np.all(own.sigma[3:] == 5)
    own = String(**string({"kind": "list", "t60": [2.0, 1.0]})).modal_body(21_609.0)
    np.testing.assert_allclose(own.sigma[:3], TO_60_DB / np.array([2, 1, 1]), rtol=1e-15)


def test_two_times_are_the_same_by_either_key():
    times = {"t60": [8.0, 3.0], "t60_at": [200.0, 2000.0]}
    flat = String(**string(None) | times).modal_body(21_609.0)
    named = String(**string({"kind": "t60", "t60": [8.0, 3.0], "frequency": [200.0, 2000.0]})).modal_body(21_609.0)
    np.testing.assert_array_equal(flat.sigma, named.sigma)
