"""Contacts in a few numbers: those of closed forms, of scenes with several touches and points, and of no contact."""

import dataclasses
import math

import numpy as np
import pytest

import engine

MASS, SPEED, STIFFNESS, DISTANCE = 0.3, 1.7, 4e4, 0.01
WALL = {
    "body": [{"name": "ball", "kind": "mass", "mass": MASS, "velocity": SPEED, "displacement": -DISTANCE}],
    "contact": [{"name": "wall", "body": "ball", "barrier": 0.0, "side": "above", "stiffness": STIFFNESS}],
    "pickup": [{"body": "ball"}],
}
GRAVITY, HEIGHT = 9.81, 0.2  # of the bouncing ball


def wall(seconds=0.05, oversample=1, **contact):
    """A mass that meets a linear wall."""
    told = WALL | {"contact": [WALL["contact"][0] | {"exponent": 1.0} | contact]}
    return engine.render(engine.load(told), seconds=seconds, trace=True, oversample=oversample).contacts


@pytest.mark.hard_for("4")
@pytest.mark.parametrize("oversample", [1, 4])
def test_a_mass_on_a_linear_wall_has_the_numbers_of_half_an_oscillation(oversample):
    """Half a period π·√(m/k), twice the momentum, v·√(m·k) and v·√(m/k), at times far finer than a sample."""
    found = wall(oversample=oversample)["wall"]
    sample = 1 / 44_100 / oversample
    assert found.first_touch == pytest.approx(DISTANCE / SPEED, abs=1e-3 * sample)
    assert found.first_duration == pytest.approx(math.pi * math.sqrt(MASS / STIFFNESS), abs=2e-2 * sample)
    assert found.duration == found.first_duration and found.touches == 1
    assert found.impulse == pytest.approx(2 * MASS * SPEED, rel=1e-9)
    assert found.peak_force == pytest.approx(SPEED * math.sqrt(MASS * STIFFNESS), rel=1e-4)
    assert found.peak_compression == pytest.approx(SPEED * math.sqrt(MASS / STIFFNESS), rel=1e-4)


@pytest.mark.parametrize(("side", "sign"), [("above", 1.0), ("below", -1.0)])
def test_compression_and_force_are_positive_on_either_side(side, sign):
    told = WALL | {"body": [WALL["body"][0] | {"velocity": sign * SPEED, "displacement": -sign * DISTANCE}]}
    told["contact"] = [WALL["contact"][0] | {"exponent": 1.0, "side": side}]
    found = engine.render(engine.load(told), seconds=0.05, trace=True).contacts["wall"]
    assert found.peak_compression == pytest.approx(SPEED * math.sqrt(MASS / STIFFNESS), rel=1e-4)
    assert found.peak_force > 0.0 and found.impulse > 0.0


def test_a_bouncing_ball_touches_again_and_again():
    """Each bounce turns the momentum of the fall round, but for what weight takes meanwhile."""
    rendering = engine.render(engine.load("bouncing_ball"), trace=True)
    ball, fall = rendering.contacts["contact.0"], math.sqrt(2 * HEIGHT / GRAVITY)
    period = 2 * fall + ball.first_duration
    assert ball.touches == math.floor((rendering.stats.seconds - fall) / period) + 1 == 4
    assert ball.first_touch == pytest.approx(fall, rel=1e-6)
    assert ball.duration == pytest.approx(4 * ball.first_duration, rel=1e-4)
    assert ball.impulse == pytest.approx(4 * (2 * GRAVITY * fall + GRAVITY * ball.first_duration), rel=1e-4)


def test_a_touch_that_goes_on_lasts_to_the_end_and_none_is_no_number():
    quarter = math.pi * math.sqrt(MASS / STIFFNESS) / 2
    cut, missed = wall(DISTANCE / SPEED + quarter)["wall"], wall(barrier=1.0)["wall"]
    assert cut.first_duration == pytest.approx(quarter, abs=2 / 44_100)
    assert cut.impulse == pytest.approx(MASS * SPEED, rel=1e-2)
    assert math.isnan(missed.first_touch)
    assert dataclasses.astuple(missed)[1:] == (0.0, 0.0, 0.0, 0.0, 0.0, 0)


def test_a_contact_at_several_points_is_the_sum_of_its_points():
    rendering = engine.render(engine.load("guitar_frets"), seconds=0.1, trace=True)
    contacts, names = rendering.contacts, rendering.trace["contacts"].tolist()
    assert list(contacts) == ["frets", "fingertip"]
    points = [contacts[name] for name in names if name.startswith("frets.")]
    assert len(points) == 20 and sum(point.touches > 0 for point in points) > 1
    assert contacts["frets"].impulse == pytest.approx(sum(point.impulse for point in points))
    assert contacts["frets"].first_touch == min(point.first_touch for point in points if point.touches)
    assert contacts["frets"].peak_compression == max(point.peak_compression for point in points)
    force = rendering.trace["force"][:, names.index("frets.7")]
    assert contacts["frets.7"].impulse == pytest.approx(np.sum(force) / 44_100)


def test_contacts_without_names_are_not_taken_for_points():
    told = WALL | {
        "contact": [{"body": "ball", "barrier": n * 1e-3, "stiffness": STIFFNESS, "exponent": 1.0} for n in range(3)]
    }
    contacts = engine.render(engine.load(told), seconds=0.05, trace=True).contacts
    assert list(contacts) == ["contact.0", "contact.1", "contact.2"]
    assert contacts["contact.0"].first_touch < contacts["contact.1"].first_touch < contacts["contact.2"].first_touch


def test_numbers_are_plain_and_shown_with_their_units():
    found = wall()["wall"]
    assert [type(value) for value in found.as_dict().values()] == [float] * 6 + [int]
    assert repr(found).startswith("ContactSummary(first_touch=0.00588235 s, ")
    assert all(f"{unit}, " in repr(found) for unit in ("N·s", "N", "m")) and repr(found).endswith("touches=1)")


def test_what_is_not_there_is_refused_with_the_remedy():
    with pytest.raises(ValueError, match="render with trace=True"):
        _ = engine.render(engine.load("bouncing_ball"), seconds=0.1).contacts
    with pytest.raises(KeyError, match='no contact "wal"; did you mean "wall"'):
        wall()["wal"]
    with pytest.raises(KeyError, match="the contacts are wall"):
        wall()[7]
    assert "wal" not in wall() and "wall" in wall()
