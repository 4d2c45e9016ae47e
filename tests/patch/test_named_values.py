"""Named values of a patch, and formulas of them."""

import math

import pytest

import engine
from engine.faults import PatchError

TEXT = """
title = "Balls"
[values]
mass = "= 4/3 * pi * radius**3 * density"
radius = "3 cm"
density = 2500.0
[[body]]
name = "ball"
kind = "mass"
mass = "= mass"
displacement = "= 2*radius"
velocity = -1.0
[[contact]]
body = "ball"
barrier = "= radius"
stiffness = "= 1e6 * radius"
exponent = 1.5
[[pickup]]
body = "ball"
"""


def written(folder, text=TEXT):
    path = folder / "balls.toml"
    path.write_text(text, "utf-8")
    return path


def test_one_radius_gives_a_mass_a_place_and_a_stiffness(tmp_path):
    scene = engine.load(written(tmp_path))
    mass = 4 / 3 * math.pi * 0.03**3 * 2500.0
    assert scene.body[0].mass == pytest.approx(mass, rel=1e-15)
    assert (scene.body[0].displacement, scene.contact[0].barrier, scene.contact[0].stiffness) == (0.06, 0.03, 3e4)


def test_another_radius_is_another_ball(tmp_path):
    scene = engine.load(written(tmp_path))
    twice = scene.replace("values.radius", 0.06)
    assert twice.body[0].mass == pytest.approx(8 * scene.body[0].mass, rel=1e-14)
    assert scene.replace("body.ball.mass", 1.0).body[0].mass == 1.0


def test_it_sounds_as_with_numbers_in_their_places(tmp_path):
    scene = engine.load(written(tmp_path))
    plain = engine.Scene.model_validate(scene.model_dump(exclude_unset=True))
    assert plain.document == plain.model_dump(exclude_unset=True)
    assert (engine.render(scene, seconds=0.01).audio == engine.render(plain, seconds=0.01).audio).all()


@pytest.mark.parametrize(
    ("values", "path", "says"),
    [
        ('radius = "= mass"', "values.mass", "it depends on itself: mass → radius → mass; give one of them a number"),
        ('radius = "= nothing"', "values.radius", "unknown name nothing; the names are pi, density"),
        ('radius = "= 1/0"', "values.radius", "it has no value (float division by zero)"),
        ('radius = "= 3 +"', "values.radius", "it is not an arithmetic expression"),
        ('radius = "3 ell"', "values.radius", 'unknown unit "ell"; such as 0.06, "6 cm" or "= 2*radius"'),
        ('radius = "wide"', "values.radius", "not a number, a number with a unit, or a formula"),
        ("radius = nan", "values.radius", "not a number"),
        ("radius = 1\nsin = 2", "values.sin", '"sin" cannot be the name of a value'),
        ("radius = 1\npi = 3", "values.pi", '"pi" cannot be the name of a value'),
    ],
)
def test_a_value_that_is_none_is_refused_with_its_line(tmp_path, values, path, says):
    text = TEXT.replace('radius = "3 cm"', values)
    with pytest.raises(PatchError) as caught:
        engine.load(written(tmp_path, text))
    (fault,) = caught.value.faults
    assert fault.path == path and says in fault.message
    assert text.splitlines()[fault.line - 1].startswith(path.partition(".")[2])


def test_a_formula_elsewhere_that_has_no_value_is_refused_with_its_line(tmp_path):
    text = TEXT.replace('"= 2*radius"', '"= 2*diameter"')
    with pytest.raises(
        PatchError, match=r"balls.toml:11 body\[0\]\.displacement: unknown name diameter; the names are"
    ):
        engine.load(written(tmp_path, text))


@pytest.mark.parametrize(("text", "number"), [("6 cm", 0.06), ("2.5e3 mm", 2.5), ("50 g", 0.05), ("7.8 g/cm3", 7800.0)])
def test_units_are_those_of_the_si_times_a_factor(text, number):
    assert engine.load(TEXT_AS_DOCUMENT | {"values": {"m": text}}).body[0].mass == pytest.approx(number, rel=1e-15)


TEXT_AS_DOCUMENT = {"body": [{"name": "b", "kind": "mass", "mass": "= m"}], "pickup": [{"body": "b"}]}


def test_values_of_an_instrument_are_those_of_its_keyboard():
    document = engine.load("vibraphone").document
    keyboard = document["keyboard"]
    document["values"] = {"unused": 2.0, **keyboard.pop("values", {})}
    assert len(engine.load(document).body) == len(engine.load("vibraphone").body)
