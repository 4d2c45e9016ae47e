"""Keys of patches that were written before the first release: unknown ones, whose errors name those that there are."""

import tomllib

import pytest

import engine
from engine.live.player import Player

PATCH = """seconds = 0.05

[[body]]
name = "string"
kind = "string"
length = 0.6
linear_density = 5e-3
tension = 60.0
bending_stiffness = 1e-4
modes = 10
sigma_beta = 0.1
sigma_beta3 = 1e-4
support = [{ at = 0.3, damping_coefficient = 0.02 }]

[[body]]
name = "plate"
kind = "plate"
size = [0.3, 0.2]
area_density = 4.0
flexural_rigidity = 20.0
modes = 6

[[body]]
name = "reed"
kind = "oscillator"
mass = 0.01
frequency = 200.0
damping_rate = 8.0
displacement = 1e-3

[[body]]
name = "bar"
kind = "bar"
length = 0.3
linear_density = 0.5
frequency = 300.0
modes = 6

[[body]]
name = "head"
kind = "membrane"
radius = 0.16
area_density = 0.26
tension = 3000.0
modes = 6

[[connection]]
name = "post"
body = "string"
at = 0.5
on = "plate"
on_at = [0.4, 0.4]
stiffness = 1e4
damping_coefficient = 0.1

[[event]]
time = 0.02
kind = "change"
connection = "post"
damping_coefficient = 1.0

[[pickup]]
body = "plate"
at = [0.3, 0.3]
"""
KEYBOARD = """
[keyboard]
keys = "C4..D4"

[[key.body]]
name = "string"
kind = "string"
length = 0.6
linear_density = 5e-3
frequency = "= f"
modes = 8

[[key.pickup]]
body = "string"
at = 0.3
"""
ANSWERS = [  # how the patch has it now, how it was written, the path of the fault, and what is said of it
    ("bending_stiffness =", "bending =", "body[0].bending", 'did you mean "bending_stiffness"?'),
    (
        "sigma_beta =",
        "sigma1 =",
        "body[0].sigma1",
        "the decay rate per wave number β is sigma_beta, m/s",
    ),
    ("sigma_beta3 =", "sigma3 =", "body[0].sigma3", "the decay rate per wave number β³ is sigma_beta3, m³/s"),
    ("damping_coefficient = 0.02", "damping = 0.02", "body[0].support[0].damping", 'mean "damping_coefficient"?'),
    ("flexural_rigidity =", "rigidity =", "body[1].rigidity", 'did you mean "flexural_rigidity"?'),
    ("damping_rate =", "damping =", "body[2].damping", 'did you mean "damping_rate"?'),
    ("damping_coefficient = 0.1", "damping = 0.1", "connection[0].damping", 'mean "damping_coefficient"?'),
    ("damping_coefficient = 1.0", "damping = 1.0", "event[0].damping", 'mean "damping_coefficient"?'),
]


@pytest.mark.parametrize(("now", "then", "path", "says"), ANSWERS, ids=[path for *_, path, _ in ANSWERS])
def test_a_key_of_the_first_weeks_is_unknown_and_the_error_names_that_of_today(tmp_path, now, then, path, says):
    file = tmp_path / "old.toml"
    assert PATCH.count(now) == 1
    file.write_text(PATCH.replace(now, then), "utf-8")
    with pytest.raises(engine.PatchError) as refused:
        engine.load(file)
    (fault,) = refused.value.faults
    assert fault.path == path and fault.message.startswith("unknown key; ") and says in fault.message


@pytest.mark.parametrize(
    ("now", "path", "missing"),
    [
        ("linear_density = 5e-3", "body[0].density", "no diameter is given"),
        ("linear_density = 0.5", "body[3].density", "no width and thickness are given"),
        ("area_density = 4.0", "body[1].density", "no thickness is given"),
        ("area_density = 0.26", "body[4].density", "no thickness is given"),
    ],
)
def test_a_density_without_a_section_or_a_thickness_is_that_of_an_old_patch(tmp_path, now, path, missing):
    """In kg/m³ it goes with one; without it can only be in kg/m or kg/m², and both readings are named."""
    file = tmp_path / "old.toml"
    name, (_, _, value) = now.partition(" ")[0], now.partition("= ")
    file.write_text(PATCH.replace(now, f"density = {value}"), "utf-8")
    with pytest.raises(engine.PatchError) as refused:
        engine.load(file)
    (fault,) = refused.value.faults
    assert fault.path == path and f"kg/m³, and {missing}" in fault.message
    unit = "kg/m" if name == "linear_density" else "kg/m²"
    assert f"if {float(value)} {unit} is meant, its name is {name}" in fault.message


def test_paths_and_live_parameters_have_the_names_of_today_alone():
    scene = engine.load(tomllib.loads(PATCH))
    with pytest.raises(engine.PatchError, match=r'did you mean "connection\.post\.damping_coefficient"'):
        scene.replace("connection.post.damping", 1.0)
    player = Player(scene)
    with pytest.raises(KeyError, match=r"the live parameters are .*connection\.post\.damping_coefficient"):
        player.set("connection.post.damping", 5.0)
    player.set("connection.post.damping_coefficient", 5.0)


def test_an_instrument_does_not_change_with_the_document_that_it_was_made_of():
    document = tomllib.loads(KEYBOARD)
    scene = engine.load(document)
    kept = scene.document
    assert kept == document
    document["key"]["body"][0]["length"] = 1.0
    assert scene.document == kept != document
