"""Events that change something: each kind of table glides its own keys, and refuses one of another kind with them."""

import pytest

import engine
from engine.patch.live_parameters import GLIDED_KEYS

NUMBERS = {"exponent": 1.5, "memory": 0.01, "bristle": 1e5, "speed": 0.2}
KEYS = sorted(set().union(*GLIDED_KEYS.values()))
SCENE = {
    "body": [
        {"name": "s", "kind": "string", "frequency": 220.0, "sigma0": 1.0, "length": 0.6, "linear_density": 1e-3},
        {"name": "m", "kind": "mass", "mass": 0.01},
    ],
    "contact": [
        {"name": "stop", "body": "s", "at": 0.3, "barrier": -1e-3, "stiffness": 1e8, "exponent": 1.5},
        {"name": "blow", "body": "m", "on": "s", "on_at": 0.2, "stiffness": 1e7, "exponent": 1.5, "gap": 1e-3},
    ],
    "connection": [
        {"name": "spring", "body": "s", "at": 0.7, "stiffness": 100.0},
        {"name": "joint", "body": "s", "at": 0.9, "rigid": True},
    ],
    "friction": [
        {"name": "bow", "body": "s", "at": 0.1, "force": 0.5, "velocity": 0.1},
        {"name": "rub", "body": "m", "on": "s", "on_at": 0.5, "force": 0.1},
    ],
    "pickup": [{"body": "s", "at": 0.4}],
}


def refusals(**event: object) -> str:
    """All that is said of a scene with one change; "" if it is good."""
    change = {"kind": "change", "time": 0.1, **event}
    try:
        engine.Scene.model_validate(SCENE | {"event": [change]})
    except ValueError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize(
    ("section", "name", "lacks"),
    [
        ("contact", "stop", {"gap": "a barrier"}),
        ("contact", "blow", {"barrier": "a gap"}),
        ("connection", "spring", {}),
        ("friction", "bow", {}),
        ("friction", "rub", {"velocity": "a second body"}),
    ],
)
def test_a_change_is_of_a_key_that_the_table_has(section, name, lacks, key):
    said = refusals(**{section: name, key: NUMBERS.get(key, 0.3)})
    if key in lacks:
        assert f'that {section} has no {key}; "{name}" has {lacks[key]}' in said
    elif key in GLIDED_KEYS[section]:
        assert said == ""
    else:
        *others, last = GLIDED_KEYS[section]
        assert f"a {section} has no {key}; give {', '.join(others)} or {last}" in said


@pytest.mark.parametrize("section", GLIDED_KEYS)
def test_a_change_says_what_it_lacks(section):
    name = {"contact": "stop", "connection": "spring", "friction": "bow"}[section]
    assert "nothing changes; give a new " in refusals(**{section: name})
    assert f'no {section} is named "x"; the named ones are ' in refusals(**{section: "x", "force": 1.0})
    assert "value is given" in refusals(**{section: name, "value": 1.0})
    other = next(other for other in GLIDED_KEYS if other != section)
    assert " are given; name the one that changes" in refusals(**{section: name, other: name})
    path = {"parameter": f"{section}.{name}.x"}
    assert "no value is given; give the value that it glides to" in refusals(**path)
    key = GLIDED_KEYS[section][0]
    assert f"parameter and {key} are both given" in refusals(**path, value=1.0, **{key: 1.0})


def test_a_rigid_joint_has_nothing_that_can_change():
    said = refusals(connection="joint", stiffness=1.0)
    assert 'that connection has no stiffness; "joint" is a rigid joint' in said
