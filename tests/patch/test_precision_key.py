"""The key `precision`: it has no effect any more, and a note says so."""

import json
import warnings

import numpy as np
import pytest

import engine
from engine.cli import main
from engine.live.player import Player
from engine.patch.accuracy import Accuracy

TEXT = """seconds = 0.01
accuracy = { precision = "float32", order = 4 }

[[body]]
name = "ball"
kind = "mass"
mass = 0.1
velocity = 1.0

[[contact]]
name = "floor"
body = "ball"
barrier = 1e-3
stiffness = 1e7
exponent = 1.5

[[pickup]]
body = "ball"
"""
SAYS = "everything is rendered in double precision, because single precision was slower at 40, 400 and 4000 modes"


def document(**accuracy) -> dict:
    ball = {"name": "ball", "kind": "mass", "mass": 0.1, "velocity": 1.0}
    floor = {"name": "floor", "body": "ball", "barrier": 1e-3, "stiffness": 1e7, "exponent": 1.5}
    whole = {"seconds": 0.01, "accuracy": accuracy, "body": [ball], "contact": [floor], "pickup": [{"body": "ball"}]}
    return json.loads(json.dumps(whole))


@pytest.fixture
def plain():
    """The same scene without the key, and its sound."""
    scene = engine.load(document(order=4))
    return scene, engine.render(scene)


def test_a_patch_with_it_is_rendered_in_double_precision(tmp_path, plain):
    path = tmp_path / "old.toml"
    path.write_text(TEXT, "utf-8")
    with pytest.warns(engine.PatchWarning) as caught:
        scene = engine.load(path)
    (note,) = caught
    assert str(note.message) == f"{path}:2 accuracy.precision: has no effect any more: {SAYS}"
    assert note.filename == __file__
    assert scene == plain[0] and "precision" not in scene.document["accuracy"]
    assert engine.render(scene).audio.tobytes() == plain[1].audio.tobytes()


def test_the_command_line_says_so_once_and_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.toml").write_text(TEXT, "utf-8")
    for words in (["check", "old.toml"], ["render", "old.toml", "--seconds", "0.01", "-o", "a.wav"]):
        assert main.main(words) == 0
        notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("note: ")]
        assert notes == [f"note: old.toml:2 accuracy.precision: has no effect any more: {SAYS}"]


@pytest.mark.hard
def test_a_sweep_says_so_once(tmp_path, monkeypatch, capfd):
    """And its workers do not."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.toml").write_text(TEXT, "utf-8")
    words = ["sweep", "old.toml", "--vary", "body.ball.mass=0.1,0.2", "--cores", "2", "-o", "set"]
    assert main.main(words) == 0
    assert capfd.readouterr().err.count("precision: has no effect") == 1


def test_the_faults_of_a_patch_keep_their_lines(tmp_path, capsys):
    (tmp_path / "wrong.toml").write_text(TEXT.replace("mass = 0.1", "mass = -0.1"), "utf-8")
    assert main.main(["check", str(tmp_path / "wrong.toml")]) == 2
    note, fault = capsys.readouterr().err.splitlines()
    assert "wrong.toml:2 accuracy.precision" in note and "wrong.toml:7 body[0].mass: -0.1 is out of range" in fault


@pytest.mark.parametrize("value", ["float32", "float64", "half"])
def test_from_python_it_is_a_warning_where_the_scene_was_made(value, plain):
    given = document(order=4, precision=value)
    for make in (engine.load, engine.Scene.model_validate):
        with pytest.warns(engine.PatchWarning) as caught:
            scene = make(given)
        assert {str(note.message) for note in caught} == {f"accuracy.precision: has no effect any more: {SAYS}"}
        assert {note.filename for note in caught} == {__file__}
        assert scene == plain[0]
    assert given == document(order=4, precision=value)


@pytest.mark.parametrize(
    "use",
    [
        lambda scene: Accuracy(order=4, precision="float32"),
        lambda scene: scene.accuracy.replace(precision="float32"),
        lambda scene: scene.replace("accuracy.precision", "float32").accuracy,
        lambda scene: Accuracy.model_validate({"order": 4, "precision": "float32"}),
    ],
)
def test_settings_with_it_are_those_without(use, plain):
    with pytest.warns(engine.PatchWarning, match=SAYS) as caught:
        accuracy = use(plain[0])
    assert {note.filename for note in caught} == {__file__}
    assert accuracy == Accuracy(order=4) and "precision" not in accuracy.model_dump()


def test_as_an_argument_of_a_rendering_too(plain):
    scene, rendering = plain
    with pytest.warns(engine.PatchWarning, match=SAYS) as caught:
        single = engine.render(scene, precision="float32")
    assert {note.filename for note in caught} == {__file__}
    assert single.audio.tobytes() == rendering.audio.tobytes()
    assert single.stats.accuracy == rendering.stats.accuracy and "precision" not in single.stats.accuracy


def test_a_player_of_a_patch_with_it_plays_in_double_precision(plain):
    with pytest.warns(engine.PatchWarning):
        old = engine.load(document(order=4, precision="float32"))
    sounds = [np.zeros((400, 1), np.float32) for _ in range(2)]
    for scene, out in zip((old, plain[0]), sounds, strict=True):
        player = Player(scene)
        assert "contact.floor.stiffness" in player.live_parameters
        player.render_into(out)
    assert sounds[0].any() and np.array_equal(*sounds)


def test_without_it_nothing_is_said(plain):
    with warnings.catch_warnings():
        warnings.simplefilter("error", engine.PatchWarning)
        scene = engine.load(document(order=4))
        engine.render(scene, order=2, max_error=1e-3)
        scene.replace("accuracy.order", 6)
