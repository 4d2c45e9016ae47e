"""Strings by what they are made of: diameter, density and Young's modulus."""

import math

import numpy as np
import pytest

import engine
from engine.bodies import String

STEEL = {"diameter": 1.0e-3, "density": 7850.0, "young": 2.0e11}
LENGTH = 0.6


def string(**keys) -> String:
    return String(**{"name": "s", "kind": "string", "length": LENGTH, "modes": 30} | keys)


def hertz(body: String) -> np.ndarray:
    return body.modal_body(1e6).omega / (2 * math.pi)


@pytest.mark.parametrize("held", [{"tension": 700.0}, {"frequency": 261.6}])
@pytest.mark.parametrize("diameter", [{}, {"core_diameter": 0.6e-3}])
def test_partials_follow_from_the_material(held, diameter):
    """fₙ = n·f0·√(1 + B·n²), B = π³·E·d⁴/(64·T·L²) (Fletcher & Rossing, sec. 2.18), within 0.1 cents."""
    body = string(**STEEL, **held, **diameter)
    mass = 7850.0 * math.pi * 1e-6 / 4
    assert body.mass_per_length() == pytest.approx(mass, rel=1e-12)
    d = diameter.get("core_diameter", 1e-3)
    tension = held.get("tension") or body.tension_and_bending()[0]
    b = math.pi**3 * 2.0e11 * d**4 / (64 * tension * LENGTH**2)
    n = np.arange(1, 31)
    wanted = n / (2 * LENGTH) * math.sqrt(tension / mass) * np.sqrt(1 + b * n**2)
    assert abs(1200 * np.log2(hertz(body) / wanted)).max() < 0.1
    if "frequency" in held:
        assert hertz(body)[0] == pytest.approx(261.6, rel=1e-12)


def test_a_modulus_with_a_core_makes_a_string_stiff():
    """It had no stiffness, silently, and rose in tension alone."""
    soft = {"linear_density": 6e-3, "tension": 100.0}
    stiff = string(**soft, young=2e11, core_diameter=5e-4)
    np.testing.assert_array_equal(hertz(stiff), hertz(string(**soft, bending_stiffness=2e11 * math.pi * 5e-4**4 / 64)))
    assert hertz(stiff)[-1] > 1.01 * hertz(string(**soft))[-1]


def test_what_is_given_comes_before_what_follows():
    material = {"tension": 700.0, **STEEL}
    np.testing.assert_array_equal(
        hertz(string(**material, inharmonicity=1e-3)),
        hertz(string(tension=700.0, linear_density=string(**material).mass_per_length(), inharmonicity=1e-3)),
    )
    assert string(**material, bending_stiffness=0.0).bending() == 0.0
    omega = string(**material).modal_body(1e6).omega
    stretching = string(**material).find_stretching(omega)
    assert stretching.stiffness == pytest.approx(2e11 * math.pi * 1e-6 / 4 / (2 * LENGTH))
    assert string(**material, axial_stiffness=0.0).find_stretching(omega) is None


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        (
            {"density": 5e-3},
            "0.005 kg/m³, and no diameter is given; give the diameter in m; if 0.005 kg/m is meant, its",
        ),
        ({"density": 7850.0, "young": 2e11}, "7850.0 kg/m³, and no diameter is given"),
        (
            {"density": 5e-3, "diameter": 1e-3},
            "0.005 kg/m³ is lighter than any string; give that of its material; if 0.005 kg/m is meant, its name is",
        ),
        ({"linear_density": 5e-3, "young": 2e11}, "no diameter is given; young in Pa goes with diameter in m"),
        ({"linear_density": 5e-3, "core_diameter": 1e-3}, "no young is given"),
        ({"linear_density": 5e-3, "diameter": 1e-3}, "a diameter of no material; give density in kg/m³"),
        ({"linear_density": 5e-3, **STEEL}, "both linear_density and density are given"),
        ({"young": 2e11, "diameter": 1e-3}, "neither linear_density nor mass nor density is given"),
    ],
)
def test_what_does_not_go_together_is_said(keys, says):
    body = {"name": "s", "kind": "string", "length": 1.0, "tension": 100.0} | keys
    with pytest.raises(engine.PatchError) as refused:
        engine.load({"body": [body], "pickup": [{"body": "s", "at": 0.3}]})
    assert says in str(refused.value) and len(refused.value.faults) <= 2


def test_decay_times_may_be_from_0_hz_on():
    """σ = σ0 + (σ1 - σ0)·(f/f1)²."""
    rate = math.log(1e3)
    keys = {"t60": [4.0, 1.0]}
    one = string(linear_density=5e-3, tension=100.0, t60_at=[0.0, 3000.0], **keys)
    f, sigma = hertz(one), one.modal_body(1e6).sigma
    np.testing.assert_allclose(sigma, rate * (1 / 4 + (1 - 1 / 4) * (f / 3000.0) ** 2), rtol=1e-12)
    law = string(linear_density=5e-3, tension=100.0, decay={"kind": "t60", "frequency": [0.0, 3000.0], **keys})
    np.testing.assert_array_equal(law.modal_body(1e6).sigma, sigma)
    for at in ([0.0, 0.0], [-1.0, 100.0], [100.0, 0.0]):
        body = {"name": "s", "kind": "string", "length": 1.0, "tension": 100.0, "linear_density": 5e-3, "t60_at": at}
        with pytest.raises(engine.PatchError):
            engine.load({"body": [body | keys], "pickup": [{"body": "s", "at": 0.3}]})
