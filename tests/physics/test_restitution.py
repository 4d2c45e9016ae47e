"""A coefficient of restitution instead of a loss: a mass that meets a barrier at a speed keeps that share of it."""

import math

import pytest
import scipy.special

import engine
from engine.patch.restitution import loss_of_restitution


def bounced(e: float, speed: float, exponent: float, **settings) -> float:
    """Return the share of its speed that a mass of 10 g keeps, in a contact of some 2 ms. speed: m/s"""
    stiffness = 0.01 * speed**2 * (exponent + 1) / 2 / (0.7e-3 * speed) ** (exponent + 1)
    ball = {"name": "ball", "kind": "mass", "mass": 0.01, "displacement": -1e-6, "velocity": speed}
    floor = {"body": "ball", "barrier": 0.0, "stiffness": stiffness, "exponent": exponent}
    floor["restitution"] = {"e": e, "speed": speed}
    heard = {"body": "ball", "quantity": "velocity"}
    scene = engine.load({"seconds": 0.1, "body": [ball], "contact": [floor], "pickup": [heard]})
    rendering = engine.render(scene, **settings)
    assert rendering.stats.trusted and rendering.stats.energy.error_max < 1e-12
    return -float(rendering.audio[-1, 0]) / speed


@pytest.mark.parametrize("settings", [{}, {"substeps": 4}, {"order": 4}, {"max_error": 1e-3}], ids=str)
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.5])
@pytest.mark.parametrize("speed", [0.3, 5.0])
@pytest.mark.parametrize("e", [0.3, 0.6, 0.9, 1.0])
def test_a_mass_keeps_the_share_of_its_speed(e, speed, exponent, settings):
    """To 0.5 %, at every setting."""
    assert bounced(e, speed, exponent, **settings) == pytest.approx(e, rel=5e-3)


@pytest.mark.parametrize("e", [0.01, 0.05, 0.2, 0.5, 0.9, 0.99, 0.9999, 1.0])
def test_the_loss_is_that_of_lamberts_w(e):
    """e = (1 + W(-(1 + d)·exp(-1 - d)))/d, with d = μ·v."""
    d = loss_of_restitution(e, 2.0) * 2.0
    if e == 1.0:
        assert d == 0.0
    else:
        value = (1 + scipy.special.lambertw(-(1 + d) * math.exp(-1 - d)).real) / d
        assert value == pytest.approx(e, rel=1e-7)
        assert loss_of_restitution(e, 1.0) == pytest.approx(d)


def told(**contact) -> dict:
    floor = {"body": "ball", "stiffness": 1e6, "exponent": 1.5, "restitution": {"e": 0.5, "speed": 1.0}} | contact
    ball = {"name": "ball", "kind": "mass", "mass": 0.01, "velocity": 1.0}
    string = {"name": "string", "kind": "string", "length": 0.6, "mass": 4e-3, "tension": 600.0}
    return {"body": [ball, string], "contact": [floor], "pickup": [{"body": "ball"}]}


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        ({"on": "string", "on_at": 0.3}, "the other body moves too"),
        ({"body": "string", "at": 0.3, "barrier": 0.0}, "the body is of kind string"),
        ({"barrier": 0.0, "loss": 0.5}, "loss and restitution are both given"),
        ({"barrier": 0.0, "relaxation": {"share": 0.3, "time": 1e-3}}, "restitution and relaxation are both given"),
        ({"barrier": 0.0, "restitution": {"e": 1.5, "speed": 1.0}}, "restitution.e"),
        ({"barrier": 0.0, "restitution": {"e": 0.5}}, "restitution.speed"),
    ],
)
def test_where_it_cannot_hold_it_is_refused(contact, said):
    with pytest.raises(ValueError, match=said.replace(".", r"\.")):
        engine.load(told(**contact))


def test_it_can_be_varied_and_kept_as_other_keys_are():
    scene = engine.load(told(barrier=0.0) | {"seconds": 0.01})
    contact = scene.contact[0]
    assert contact.loss == loss_of_restitution(0.5, 1.0)
    assert engine.load(scene.model_dump(exclude_unset=True)).contact[0] == contact
    assert scene.replace("contact.0.restitution.e", 0.9).contact[0].loss == loss_of_restitution(0.9, 1.0)
