"""Keys with old names: they work as the new ones do, and one note says so."""

import copy
import csv
import json
import tomllib
import warnings

import jsonschema
import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.cli import main
from engine.live.player import Player
from engine.patch.editor_schema import editor_schema
from engine.patch.renamed_keys import RENAMED, RenamedKeys, rename_keys

OLD = """seconds = 0.05

[[body]]
name = "string"
kind = "string"
length = 0.6
linear_density = 5e-3
tension = 60.0
bending = 1e-4
modes = 10
sigma1 = 0.1
sigma3 = 1e-4
support = [{ at = 0.3, damping = 0.02 }]

[[body]]
name = "plate"
kind = "plate"
size = [0.3, 0.2]
density = 4.0
rigidity = 20.0
modes = 6

[[body]]
name = "reed"
kind = "oscillator"
mass = 0.01
frequency = 200.0
damping = 8.0
displacement = 1e-3

[[connection]]
name = "post"
body = "string"
at = 0.5
on = "plate"
on_at = [0.4, 0.4]
stiffness = 1e4
damping = 0.1

[[event]]
time = 0.02
kind = "change"
connection = "post"
damping = 1.0

[[contact]]
name = "stop"
body = "reed"
on = "string"
on_at = 0.2
stiffness = 1e6
exponent = 1.5

[[pickup]]
body = "plate"
at = [0.3, 0.3]
"""
SWAPS = [
    ("density = 4.0", "area_density = 4.0"),
    ("bending =", "bending_stiffness ="),
    ("rigidity =", "flexural_rigidity ="),
    ("sigma1 =", "sigma_beta ="),
    ("sigma3 =", "sigma_beta3 ="),
    ("damping = 8.0", "damping_rate = 8.0"),
    ("damping = 0.02", "damping_coefficient = 0.02"),
    ("damping = 0.1", "damping_coefficient = 0.1"),
    ("damping = 1.0", "damping_coefficient = 1.0"),
]
KEYBOARD = """
[keyboard]
keys = "C4..D4"

[[key.body]]
name = "string"
kind = "string"
length = 0.6
linear_density = "= 5e-3*f/261.6"
frequency = "= f"
modes = 8
sigma1 = -1.0

[[key.pickup]]
body = "string"
at = 0.3
"""


def new() -> str:
    text = OLD
    for old, name in SWAPS:
        assert text.count(old) == 1
        text = text.replace(old, name)
    return text


@pytest.fixture
def patches(tmp_path, monkeypatch):
    """A folder with the patch in its old and in its new words."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.toml").write_text(OLD, "utf-8")
    (tmp_path / "new.toml").write_text(new(), "utf-8")


def notes(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith("note: ")]


def test_old_keys_make_the_same_scene_and_a_dump_has_the_new(patches):
    with pytest.warns(engine.PatchWarning):
        old = engine.load("old.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert engine.load("new.toml") == old
        again = engine.Scene.model_validate(json.loads(json.dumps(old.model_dump(exclude_none=True))))
    assert again == old and old.body[2].damping_rate == 8.0
    dumped = [key for table in old.model_dump(exclude_unset=True)["body"] for key in table]
    assert not set(dumped) & set(RENAMED["body"])


@pytest.mark.parametrize("path", sorted((ROOT / "patches").rglob("*.toml")), ids=lambda path: path.stem)
def test_shipped_patches_have_the_new_keys(path):
    document, renamed = tomllib.loads(path.read_text("utf-8")), RenamedKeys()
    assert rename_keys(document, renamed) == document and not renamed.by_path


def test_editors_know_the_old_keys_but_not_beside_the_new():
    check = jsonschema.Draft7Validator(editor_schema())
    for text in (OLD, new(), KEYBOARD):
        assert not list(check.iter_errors(tomllib.loads(text)))
    renamed = RenamedKeys()
    rename_keys(tomllib.loads(OLD), renamed)
    assert len(renamed.by_path) == len(SWAPS)
    for key in renamed.by_path.values():
        document = tomllib.loads(OLD)
        table = document
        for part in key.path[:-1]:
            table = table[part]
        table[key.new] = table[key.path[-1]]
        assert list(check.iter_errors(document)), key
        with pytest.raises(ValueError, match="and are the same"):
            engine.Scene.model_validate(document)


def test_a_note_names_the_new_key_once_for_each_old_one(patches, capsys):
    assert main.main(["check", "old.toml"]) == 0
    said = notes(capsys.readouterr().err.splitlines())
    assert len(said) == 7  # of the keys in kg/s, the first
    assert "note: old.toml:19 body[1].density: now called area_density (kg/m²); the old name still works" in said
    assert any(
        line.startswith("note: old.toml:13 body[0].support[0].damping: now called damping_coef") for line in said
    )
    assert any("body[2].damping: now called damping_rate (1/s)" in line for line in said)
    assert main.main(["check", "new.toml"]) == 0
    assert capsys.readouterr().err == ""


def test_from_python_a_note_is_a_warning_where_the_scene_was_made():
    document = tomllib.loads(OLD)
    kept = copy.deepcopy(document)
    with pytest.warns(engine.PatchWarning) as caught:
        engine.Scene.model_validate(document)
    assert any(str(w.message).startswith("body.2.damping: now called damping_rate") for w in caught)
    assert {warning.filename for warning in caught} == {__file__}
    assert document == kept


def test_from_python_a_note_on_a_file_is_a_warning_where_it_was_loaded(tmp_path):
    (tmp_path / "old.toml").write_text(OLD, "utf-8")
    with pytest.warns(engine.PatchWarning) as caught:
        engine.load(tmp_path / "old.toml")
    assert {warning.filename for warning in caught} == {__file__}


@pytest.mark.parametrize(
    "old, wrong, line, says",
    [
        (
            "density = 4.0",
            "density = -1.0",
            19,
            "body[1].density: -1.0 is out of range; mass per area, kg/m², more than 0",
        ),
        ("rigidity = 20.0", 'rigidity = "stiff"', 20, 'body[1].rigidity: "stiff" is not a number; flexural rigidity D'),
        ("damping = 0.02", "damping = nan", 13, "body[0].support[0].damping: nan is not a finite number"),
        ("damping = 1.0", "damping = -1.0", 44, "event[0].damping: -1.0 is out of range"),
        (
            "damping = 8.0",
            "damping = 8.0\ndamping_rate = 8.0",
            28,
            "body[2].damping: damping and damping_rate are both given",
        ),
    ],
)
def test_faults_of_old_keys_have_their_line_and_the_name_that_the_patch_has(tmp_path, old, wrong, line, says, capsys):
    path = tmp_path / "wrong.toml"
    path.write_text(OLD.replace(old, wrong), "utf-8")
    assert main.main(["check", str(path)]) == 2
    faults = [text for text in capsys.readouterr().err.splitlines() if not text.startswith("note: ")]
    assert len(faults) == 1 and f"wrong.toml:{line} {says}" in faults[0]


def test_faults_of_the_keys_of_an_instrument_too(tmp_path, capsys):
    path = tmp_path / "keys.toml"
    path.write_text(KEYBOARD, "utf-8")
    assert main.main(["check", str(path)]) == 2
    error = capsys.readouterr().err
    assert "keys.toml:12 key.body[0].sigma1: -1.0 is out of range" in error
    assert "keys.toml:12 key.body[0].sigma1: now called sigma_beta" in error


def test_a_density_of_a_string_is_of_its_material_and_no_old_key(tmp_path, capsys):
    """In kg/m³, with a diameter; without one it can only be the old one, and both readings are named."""
    path = tmp_path / "keys.toml"
    path.write_text(KEYBOARD.replace("linear_density", "density").replace("sigma1 = -1.0", ""), "utf-8")
    assert main.main(["check", str(path)]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert "key.body[0].density: 0.00" in error and "kg/m³, and no diameter is given" in error
    assert "kg/m is meant, its name is linear_density" in error


def test_faults_of_a_build_too(tmp_path, capsys):
    path = tmp_path / "wrong.toml"
    path.write_text(OLD.replace("seconds = 0.05\n", "seconds = 0.05\naccuracy = { order = 4 }\n").replace("0.1", "1e5"))
    assert main.main(["check", str(path)]) == 2
    assert "connection[0].damping: order 4 has steps back in time" in capsys.readouterr().err


@pytest.mark.hard
def test_a_path_of_a_sweep_may_have_either_name(patches):
    levels = []
    for patch, key in (("old", "damping"), ("old", "damping_rate"), ("new", "damping")):
        axis = f"body.reed.{key}"
        more = ["--vary", "connection.post.damping=0.2,0.4", "--cores", "1", "-o", f"{patch}_{key}"]
        assert main.main(["sweep", f"{patch}.toml", "--vary", f"{axis}=1,1000", *more]) == 0
        with open(f"{patch}_{key}/index.csv", newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert [row[axis] for row in rows] == ["1", "1", "1000", "1000"]
        levels.append([row["rms"] for row in rows])
    assert len(set(levels[0])) == 4 and levels[0] == levels[1] == levels[2]


def test_live_parameters_may_have_either_name(patches):
    heard = []
    for key in ("damping", "damping_coefficient"):
        player = Player(engine.load("new.toml"))
        player.set(f"connection.post.{key}", 5.0, 0.001)
        out = np.zeros((2000, player.channels), np.float32)
        player.render_into(out)
        heard.append(out)
    assert heard[0].any() and np.array_equal(*heard)
