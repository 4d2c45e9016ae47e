"""The short form of bows: what it stands for, and what is said of one that cannot be."""

import tomllib

import pytest
from conftest import ROOT

import engine
from engine.cli import main
from engine.faults import PatchError
from engine.patch.paths import locate

PATCH = """[[body]]
name = "string"
kind = "string"
length = 0.325
tension = 43.0
linear_density = 1.18e-3

[[bow]]
name = "bow"
body = "string"
at = 0.11
velocity = 0.2
force = 0.5
strokes = [{ time = 0.0, duration = 0.8 }, { time = 0.8, duration = 0.5, force = 0.3 }, { time = 1.5, duration = 0.4 }]

[[pickup]]
body = "string"
at = 0.3
"""
KEYBOARD = """
[keyboard]
keys = "G3..A3"

[[key.body]]
name = "string"
kind = "string"
length = 0.3
linear_density = 1e-3
frequency = "= f"

[[key.bow]]
name = "bow"
body = "string"
at = 0.1

[[key.on]]
kind = "change"
friction = "bow"
velocity = "= 0.5*v"
force = 0.5

[[key.pickup]]
body = "string"
at = 0.3
"""


def load(folder, text: str) -> engine.Scene:
    (folder / "bow.toml").write_text(text, "utf-8")
    return engine.load(folder / "bow.toml")


def test_a_bow_is_friction_and_the_events_of_its_strokes(tmp_path):
    """Each stroke goes against the one before; the bow turns where they meet, and is lifted elsewhere."""
    scene = load(tmp_path, PATCH)
    (friction,) = scene.friction
    assert (friction.name, friction.body, friction.at) == ("bow", "string", 0.11)
    assert friction.velocity == friction.force == 0.0  # until the first stroke
    moves = [(e.time, e.velocity, e.force, e.duration) for e in scene.event]
    assert moves == [
        (0.0, 0.2, 0.5, 0.03),
        (0.8, -0.2, 0.3, 0.03),
        (pytest.approx(1.27), 0.0, 0.0, 0.03),
        (1.5, 0.2, 0.5, 0.03),
        (pytest.approx(1.87), 0.0, 0.0, 0.03),
    ]
    assert scene == engine.load(scene.document)


def test_a_bow_without_strokes_moves_all_the_time(tmp_path):
    text = "\n".join(line for line in PATCH.splitlines() if not line.startswith("strokes"))
    scene = load(tmp_path, text)
    assert (scene.friction[0].velocity, scene.friction[0].force) == (0.2, 0.5) and not scene.event


def test_an_envelope_replaces_the_attack_and_the_release_of_what_it_shapes(tmp_path):
    stroke = "strokes = [{ time = 0.1, duration = 1.0, force_envelope = [[0.0, 0.5], [0.4, 2.0], [1.0, 0.0]] }]"
    lines = [stroke if line.startswith("strokes") else line for line in PATCH.splitlines()]
    events = load(tmp_path, "\n".join(lines)).event
    assert [(e.time, e.force) for e in events if e.force is not None] == [(0.1, 0.25), (0.1, 1.0), (0.5, 0.0)]
    assert [(e.time, e.velocity) for e in events if e.velocity is not None] == [(0.1, 0.2), (1.07, 0.0)]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("time = 1.5", "time = 1.2", "14 bow[0].strokes[2].time: the one before it ends at 1.3 s"),
        ("velocity = 0.2", "velocity = -0.2", "12 bow[0].velocity: a bow with strokes has a negative velocity"),
        ("velocity = 0.2", "", "14 bow[0].strokes[0].velocity: the stroke has no velocity"),
        ("duration = 0.8", "duration = 0.05", "14 bow[0].strokes[0].duration: attack and release take 0.06 s"),
        ("at = 0.11", "at = 1.5", "11 bow[0].at: 1.5 is not a position"),
        ("time = 1.5", "time = 2.5", "14 bow[0].strokes[2].time: after the end"),
        ("force = 0.3", 'direction = "left"', "14 bow[0].strokes[1].direction: \"left\" is not known; expected 'down'"),
        ("force = 0.3", "velocity_envelope = [[0.9, 1.0]]", "14 bow[0].strokes[1].velocity_envelope: it goes on after"),
        ("force = 0.3", "force_envelope = [[0.2, -1.0]]", "14 bow[0].strokes[1].force_envelope: a factor is negative"),
        ("force = 0.3", "force_envelope = [[0.2, 1], [0.1, 1]]", "14 bow[0].strokes[1].force_envelope: its times do"),
        ("force = 0.5", "pressure = 0.5", "13 bow[0].pressure: unknown key"),
        ("at = 0.11", "at = 0.11\ndynamic = 0.9", "12 bow[0].dynamic: dynamic = 0.9 is above static = 0.8"),
    ],
)
def test_a_bow_that_cannot_be_is_refused_at_its_line(old, new, says, tmp_path):
    with pytest.raises(PatchError) as error:
        load(tmp_path, PATCH.replace(old, new, 1))
    assert f"bow.toml:{says}" in str(error.value)


def test_what_cannot_be_built_is_refused_at_the_line_of_the_bow(capsys):
    assert main.main(["inspect", "bowed_violin", "--order", "4"]) == 2
    line = (ROOT / "patches" / "bowed_violin.toml").read_text("utf-8").splitlines().index("[[bow]]") + 1
    assert f"bowed_violin.toml:{line} bow[0]: friction has order 2, not 4" in capsys.readouterr().err


def test_each_key_of_an_instrument_has_its_own_bow(tmp_path):
    scene = load(tmp_path, KEYBOARD + '[[note]]\ntime = 0.0\nkey = "A3"\nvelocity = 127\n')
    assert [f.name for f in scene.friction] == ["A3_bow"] and scene.friction[0].body == "A3_string"
    assert [(e.friction, e.velocity) for e in scene.event] == [("A3_bow", 0.5)]
    with pytest.raises(PatchError, match=r"key\.bow\[0\]\.strokes: the bow of an instrument has no strokes"):
        load(tmp_path, KEYBOARD.replace("at = 0.1\n", "at = 0.1\nstrokes = [{ time = 0.0, duration = 1.0 }]\n"))


def test_a_value_of_a_bow_is_found_by_the_path_of_its_friction(tmp_path):
    scene = load(tmp_path, PATCH)
    assert scene.replace("friction.bow.static", 0.6).friction[0].static == 0.6
    assert locate("friction.bow.static", scene, tomllib.loads(PATCH))[0] == ("bow", 0, "static")
