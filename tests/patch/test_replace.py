"""Scenes with other values, from Python: paths, values, and what is wrong with them."""

import numpy as np
import pytest
from conftest import PATCHES

import engine

PIANO = engine.load("piano_c4")


@pytest.mark.hard
@pytest.mark.parametrize("path", PATCHES, ids=lambda p: p.stem)
def test_every_parameter_can_be_replaced_and_its_own_value_changes_nothing(path):
    """Those of an instrument are written out of its formulas; there it is its seconds alone."""
    scene = engine.load(path)
    given = {p.path: p.value for p in scene.parameters()}
    if scene.instrument:
        given = {path: value for path, value in given.items() if path == "seconds" and path in scene.instrument}
    assert [(p.path, p.value) for p in scene.replace(given).parameters()] == [
        (p.path, p.value) for p in scene.parameters()
    ]


def test_a_replaced_value_is_that_of_the_new_scene_alone():
    harder = PIANO.replace("contact.felt.stiffness", 1e10)
    assert (harder.contact[0].stiffness, PIANO.contact[0].stiffness) == (1e10, 4.5e9)
    assert harder.replace("contact.felt.stiffness", 4.5e9) == PIANO


def test_a_path_may_have_numbers_as_faults_have_them():
    assert PIANO.replace("body[1].velocity", 2.0) == PIANO.replace("body.hammer.velocity", 2.0)
    with pytest.raises(engine.PatchError, match=r'there is no "body.1.velo"; did you mean "body.1.velocity"'):
        PIANO.replace("body[1].velo", 2.0)


def test_a_value_beside_a_dict_is_refused():
    for path in ({"contact.felt.stiffness": 1e10}, {}):
        with pytest.raises(ValueError, match=r"value = 2\.0 belongs to no path; leave it out"):
            PIANO.replace(path, 2.0)


def test_several_values_are_replaced_at_once():
    """As a dict or as keywords; also one that the patch leaves at its default."""
    changes = {"body.hammer.velocity": 2.0, "accuracy.substeps": 4}
    changed = PIANO.replace(changes)
    assert changed == PIANO.replace(**changes)
    assert (changed.body[1].velocity, changed.accuracy.substeps) == (2.0, 4)


def test_an_instrument_has_the_value_on_every_key():
    kalimba = engine.load("kalimba_keys")
    lighter = kalimba.replace("key.body.0.linear_density", 0.03)
    tongues = [body.linear_density for body in lighter.body if body.kind == "bar"]
    assert len(tongues) > 1 and set(tongues) == {0.03}
    with pytest.raises(engine.PatchError, match="change what is under key"):
        kalimba.replace(f"body.{next(b.name for b in kalimba.body if b.kind == 'bar')}.linear_density", 0.03)


def test_numbers_of_numpy_are_numbers():
    assert PIANO.replace("contact.felt.stiffness", np.float32(1e9)).contact[0].stiffness == 1e9
    moved = engine.load("ball_on_drum").replace("pickup.0.at", np.array([0.25, 0.75]))
    assert moved.pickup[0].at == [0.25, 0.75]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"contact.fellt.loss": 0.0}, 'there is no "contact.fellt"; did you mean "contact.felt.loss"?'),
        ({"contact.felt.stiffnes": 0.0}, 'did you mean "contact.felt.stiffness"?'),
        ({"contact.felt": 0.0}, "contact.felt: a table; give one of its keys: contact.felt.name"),
        ({"contact.felt.exponent": 0.5}, "contact[0].exponent: 0.5 is out of range"),
        ({"contact.felt.exponent": "high"}, '"high" is not a number'),
        ({"body.string.tension": 600.0}, "body[0]"),
    ],
)
def test_what_cannot_be_is_refused_with_the_remedy(changes, says):
    with pytest.raises(engine.PatchError) as refused:
        PIANO.replace(changes)
    assert says in str(refused.value) and str(refused.value).startswith("scene ")


def test_all_faults_are_said_at_once():
    with pytest.raises(engine.PatchError) as refused:
        PIANO.replace({"contact.felt.exponent": 0.5, "contact.felt.loss": -1.0})
    assert len(refused.value.faults) == 2


def test_a_path_is_text():
    with pytest.raises(TypeError, match=r'3 is not a path; give text, such as "seconds"|"body'):
        PIANO.replace(3, 1.0)
