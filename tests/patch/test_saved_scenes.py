"""Scenes that are saved are read as the same scenes."""

import json

import numpy as np
import pytest
import soundfile
from conftest import PATCHES

import engine
from bench.scenes.random_scenes import joined_scene
from bench.scenes.random_scenes import scene as random_scene

SEEDS = [*range(8), *(pytest.param(seed, marks=pytest.mark.hard) for seed in range(8, 200))]


def is_same(scene: engine.Scene, other: engine.Scene) -> bool:
    """True if two scenes have the same values, to the last bit."""
    return repr(scene.model_dump()) == repr(other.model_dump()) and scene.vary == other.vary


@pytest.mark.parametrize("path", PATCHES, ids=[path.stem for path in PATCHES])
@pytest.mark.parametrize("name", ["a.toml", "a.json"])
def test_every_shipped_patch_is_read_as_it_was_saved(tmp_path, path, name):
    scene = engine.load(path)
    scene.save(tmp_path / name)
    again = engine.load(tmp_path / name)
    assert is_same(scene, again)
    if scene.instrument is not None:
        assert again.instrument == scene.instrument


@pytest.mark.parametrize("seed", SEEDS)
def test_random_scenes_are_read_as_they_were_saved(tmp_path, seed):
    scene = joined_scene(seed) if seed % 2 else random_scene(seed)
    scene.save(tmp_path / "a.toml")
    assert is_same(scene, engine.load(tmp_path / "a.toml"))


def test_it_sounds_the_same(tmp_path):
    scene = engine.load("marble_on_a_bell").replace("body.marble.mass", 1 / 300)
    scene.save(tmp_path / "a.toml")
    first, second = (engine.render(one, seconds=0.05).audio for one in (scene, engine.load(tmp_path / "a.toml")))
    np.testing.assert_array_equal(first, second)


def test_units_are_comments():
    assert "mass = 0.005 # kg" in engine.load("marble_on_a_bell").replace("body.marble.mass", 0.005).to_toml()


def test_named_values_stay_formulas(tmp_path):
    document = {
        "values": {"m": "50 g", "v": "= 2*m"},
        "vary": {"m": "0.01..0.1:log", "seed": 3},
        "body": [{"name": "b", "kind": "mass", "mass": "= m", "velocity": "= v"}],
        "pickup": [{"body": "b"}],
    }
    engine.load(document).save(tmp_path / "a.toml")
    again = engine.load(tmp_path / "a.toml")
    assert again.document == document and again.replace("values.m", 1.0).body[0].velocity == 2.0


def test_files_beside_a_patch_are_named_from_its_new_place(tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "new").mkdir()
    soundfile.write(tmp_path / "old" / "push.wav", np.sin(np.arange(400.0)), 44_100)
    body = {"name": "b", "kind": "mass", "mass": 1.0}
    force = {"body": "b", "kind": "file", "file": "push.wav", "amplitude": 1.0}
    text = json.dumps({"body": [body], "force": [force], "pickup": [{"body": "b"}]})
    (tmp_path / "old" / "a.json").write_text(text, "utf-8")
    scene = engine.load(tmp_path / "old" / "a.json")
    scene.save(tmp_path / "new" / "a.toml")
    assert 'file = "../old/push.wav"' in (tmp_path / "new" / "a.toml").read_text("utf-8")
    assert is_same(scene, engine.load(tmp_path / "new" / "a.toml"))


@pytest.mark.parametrize(("text", "says"), [("{", "not valid JSON"), ("[1]", "not a patch; write an object")])
def test_json_that_is_no_patch_is_refused(tmp_path, text, says):
    (tmp_path / "a.json").write_text(text, "utf-8")
    with pytest.raises(engine.PatchError, match=says):
        engine.load(tmp_path / "a.json")


def test_what_is_no_part_of_a_patch_is_named():
    with pytest.raises(ValueError, match="gain of channels 1 was set by a session"):
        engine.load("bouncing_ball").with_output_gain(0, 0.5).to_toml()
