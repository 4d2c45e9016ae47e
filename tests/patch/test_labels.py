"""Names of live parameters for people, in `[labels]` of a patch."""

import json

import pytest

import engine
from engine.cli.main import main
from engine.patch.labels import find_unused_labels, labels_of
from engine.patch.live_parameters import live_paths


def labelled(name, labels):
    return engine.load(name).document | {"labels": labels}


def test_a_label_is_shown_with_the_parameter(tmp_path, capsys):
    scene = engine.load(labelled("piano_c4", {"contact.felt.stiffness": "hardness of the felt"}))
    assert {p.path: p.label for p in scene.parameters() if p.label} == {
        "contact.felt.stiffness": "hardness of the felt"
    }
    scene.save(tmp_path / "x.toml")
    assert engine.load(tmp_path / "x.toml").labels == scene.labels
    assert main(["params", str(tmp_path / "x.toml")]) == 0
    assert "hardness of the felt: stiffness kc" in capsys.readouterr().out
    assert main(["params", str(tmp_path / "x.toml"), "--json"]) == 0
    listed = {p["path"]: p["label"] for p in json.loads(capsys.readouterr().out)["params"]}
    assert listed["contact.felt.stiffness"] == "hardness of the felt" and listed["contact.felt.gap"] == ""


def test_a_label_of_an_instrument_is_that_of_each_key():
    scene = engine.load(labelled("snare", {"contact.rim.stiffness": "hardness of the rim"}))
    assert labels_of(scene, live_paths(scene)) == {
        "contact.Cs2_rim.stiffness": "hardness of the rim, C#2",
        "contact.E2_rim.stiffness": "hardness of the rim, E2",
    }


def test_a_label_may_be_that_of_a_key_that_is_not_played():
    document = labelled("snare", {"contact.palm.stiffness": "hardness of the palm"})
    document["note"] = [{"time": 0.0, "key": "D2", "velocity": 90}]
    scene = engine.load(document)
    assert scene.labels and labels_of(scene, live_paths(scene)) == {}
    assert find_unused_labels(scene) == []


def test_a_label_of_no_live_parameter_does_no_harm_and_check_says_so(tmp_path, capsys):
    """Such as that of a contact that is switched off."""
    scene = engine.load("piano_c4")
    assert scene.labels and find_unused_labels(scene) == []
    assert find_unused_labels(scene.replace("contact.felt.stiffness", 0.0)) != []
    path = tmp_path / "x.toml"
    engine.load(labelled("piano_c4", {"contact.fellt.stiffness": "x", "body.hammer.velocity": "y"})).save(path)
    assert main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    for name in ("contact.fellt.stiffness", "body.hammer.velocity"):
        assert f"a label names no live parameter {name}; the live parameters are " in said


def test_no_formula_is_looked_for_in_a_label():
    document = labelled("piano_c4", {"contact.felt.stiffness": "= hardness"})
    assert engine.load(document).labels == {"contact.felt.stiffness": "= hardness"}


@pytest.mark.parametrize(
    ("labels", "said"),
    [
        ({"contact.felt.stiffness": ""}, "no text of 1 to 60 letters"),
        ({"contact.felt.stiffness": "x" * 61}, "no text of 1 to 60 letters"),
        ({"contact": {"felt": {"stiffness": "x"}}}, "write the path in quotes"),
        ("x", r"write \[labels\]"),
    ],
)
def test_a_wrong_label_is_refused_in_a_line(labels, said):
    with pytest.raises(engine.PatchError, match=said) as error:
        engine.load(labelled("piano_c4", labels))
    assert str(error.value).count("\n") == 0
