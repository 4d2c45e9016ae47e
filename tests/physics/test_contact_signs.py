"""The signs that docs/contact_signs.png tells of (bench/publish/signs.py): what a compression is."""

import pytest

import engine


def compression(contact: dict, **displacements: float) -> float:
    """The compression at time 0 of a contact of masses at some displacements, m."""
    bodies = [
        {"name": name, "kind": "mass", "mass": 1.0, "displacement": u, "velocity": 1.0}
        for name, u in displacements.items()
    ]
    scene = {
        "body": bodies,
        "contact": [contact | {"stiffness": 1.0, "exponent": 1.5}],
        "pickup": [{"body": bodies[0]["name"]}],
    }
    return float(engine.render(engine.Scene.model_validate(scene), seconds=1e-3, trace=True).trace["compression"][0, 0])


@pytest.mark.parametrize(
    ("side", "barrier", "expected"),
    [("above", 2e-3, 3e-3 - 2e-3), ("below", -2e-3, -2e-3 - 3e-3), ("below", 4e-3, 4e-3 - 3e-3)],
)
def test_a_barrier(side, barrier, expected):
    """s = u - barrier where the barrier is above, barrier - u where it is below."""
    contact = {"body": "ball", "side": side, "barrier": barrier}
    assert compression(contact, ball=3e-3) == pytest.approx(expected)


@pytest.mark.parametrize(("side", "sign"), [("above", 1.0), ("below", -1.0)])
def test_two_bodies(side, sign):
    """s = u(body) - u(on) - gap where the other is above, u(on) - u(body) - gap where it is below."""
    contact = {"body": "hammer", "on": "block", "side": side, "gap": 1e-3}
    assert compression(contact, hammer=sign * 5e-3, block=sign * 2e-3) == pytest.approx(5e-3 - 2e-3 - 1e-3)
