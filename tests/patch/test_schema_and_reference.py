"""What is told of patches: schema, reference, parameters and templates, all from the models."""

import json
import math
import tomllib
from pathlib import Path

import jsonschema
import pytest
from conftest import PATCHES, ROOT

import engine
from engine.analysis.features import features
from engine.cli import main
from engine.instrument.expansion import OWN_TABLES, expand, is_instrument
from engine.instrument.key_names import note_frequency, parse_key
from engine.patch import json_schema, reference_page
from engine.patch.bow import expand_bows
from engine.patch.live_parameters import live_paths
from engine.patch.materials import fill_in_materials
from engine.patch.named_values import fill_in_values
from engine.patch.note_scene import scene_of_note
from engine.patch.parameters import list_parameters

TEMPLATES = sorted((ROOT / "patches" / "templates").glob("*.toml"))
SCHEMA = ROOT / "patches" / "patch.schema.json"
# numbers without a unit, and places
DIMENSIONLESS = {
    "Restitution.e",
    "at", "on_at", "modes", "inharmonicity", "ratios", "points", "count", "exponent", "channel", "gain",
    "order", "substeps", "max_error", "max_substeps", "tolerance", "oversample", "iterations",
    "b", "eta", "number", "x", "y", "scale",
    "pan", "poisson", "Note.velocity", "Note.release", "polyphony", "sustain", "soft", "sostenuto",
    "envelope", "velocity_envelope", "force_envelope", "static", "dynamic", "seed", "share", "polarisations",
    "range", "input", "ChangeEvent.value", "bend", "bend_range", "mpe_lower", "mpe_upper", "mpe_bend_range",
    "Tremolo.depth", "spread", "patch.values", "patch.vary",
}  # fmt: skip
PICKUP = {"body": "a"}
MASS = {"name": "a", "kind": "mass", "mass": 1.0}
TOUCH = {"body": "a", "stiffness": 1.0, "exponent": 1.0}
STRING = {"name": "a", "kind": "string", "length": 1.0, "mass": 1.0, "tension": 1.0}


def validator() -> jsonschema.Draft7Validator:
    schema = json.loads(SCHEMA.read_text("utf-8"))
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


def tables() -> dict[str, dict]:
    """All tables of the schema by name."""
    whole = json_schema.patch_schema()
    return {"patch": reference_page.top_level(whole), **whole["definitions"]}


@pytest.mark.hard
def test_the_committed_schema_and_reference_are_those_of_the_models(capsys):
    assert main.main(["schema"]) == 0
    assert capsys.readouterr().out == SCHEMA.read_text("utf-8"), "fdh schema > patches/patch.schema.json"
    assert main.main(["reference"]) == 0
    wanted = (ROOT / "docs" / "patches.md").read_text("utf-8")
    assert capsys.readouterr().out == wanted, "fdh reference > docs/patches.md"


def test_every_patch_names_its_schema_and_keeps_to_it():
    check = validator()
    for path in [*PATCHES, *TEMPLATES]:
        text = path.read_text("utf-8")
        assert not list(check.iter_errors(tomllib.loads(text))), path
        if path in PATCHES:
            directive, _, way = text.splitlines()[0].partition(" ")
            assert directive == "#:schema" and (path.parent / way).samefile(SCHEMA)


@pytest.mark.hard
@pytest.mark.parametrize(
    "data",
    [
        {"pickup": [PICKUP]},
        {"body": [MASS]},
        {"body": [], "pickup": [PICKUP]},
        {"body": [MASS], "pickup": [PICKUP], "secnds": 1.0},
        {"body": [MASS], "pickup": [PICKUP], "seconds": 0.0},
        {"body": [MASS], "pickup": [PICKUP], "accuracy": {"order": 3}},
        {"body": [MASS | {"mass": -1.0}], "pickup": [PICKUP]},
        {"body": [MASS | {"mass": "heavy"}], "pickup": [PICKUP]},
        {"body": [MASS | {"kind": "ball"}], "pickup": [PICKUP]},
        {"body": [MASS | {"stiffness": 1.0}], "pickup": [PICKUP]},
        {"body": [{"name": "a", "kind": "mass"}], "pickup": [PICKUP]},
        {"body": [STRING | {"linear_density": 1.0}], "pickup": [PICKUP]},
        {"body": [STRING | {"bending_stiffness": 1.0, "inharmonicity": 1.0}], "pickup": [PICKUP]},
        {"body": [STRING], "pickup": [PICKUP | {"at": 1.5}]},
        {"body": [STRING], "pickup": [PICKUP | {"at": []}]},
        {"body": [MASS], "pickup": [PICKUP], "contact": [TOUCH | {"barrier": "no"}]},
    ],
)  # fmt: skip
def test_the_schema_refuses_what_the_engine_refuses(data):
    assert list(validator().iter_errors(data))
    with pytest.raises(ValueError):
        engine.Scene.model_validate(data)
    assert not list(validator().iter_errors({"body": [STRING], "pickup": [PICKUP | {"at": 0.5}]}))


def test_every_number_has_a_unit_or_needs_none():
    """By the convention of descriptions: meaning, unit; more."""
    assert reference_page.split_unit("length, m; of the string") == ("length; of the string", "m")
    assert reference_page.split_unit("damping γ, 1/s: force") == ("damping γ: force", "1/s")
    assert reference_page.split_unit("one, me and two") == ("one, me and two", "")
    seen = set()
    for name, table in tables().items():
        for key in reference_page.key_rows(table):
            numeric = json.dumps(table["properties"][key.name]).count('"number"') or key.range.startswith("whole")
            if numeric and key.unit == "":
                known = {key.name, f"{name}.{key.name}"} & DIMENSIONLESS
                assert known, f"{name}.{key.name}: {key.meaning}"
                seen |= known
            assert key.meaning, f"{name}.{key.name}"
            assert key.unit == "" or key.name not in DIMENSIONLESS - {"points"}, f"{name}.{key.name}"
    assert seen | {"points", "order"} == DIMENSIONLESS


@pytest.mark.hard
def test_the_reference_has_every_key():
    text = reference_page.reference_page()
    for table in tables().values():
        for key in reference_page.key_rows(table):
            assert f"| `{key.name}` | {key.unit} | {key.range} | {key.default} | {key.meaning} |" in text
    assert "| `length` | m | > 0, ≤ 10000 | required | length |" in text


@pytest.mark.hard
def test_params_lists_every_number_by_its_path(capsys):
    path = str(ROOT / "patches" / "piano_c4.toml")
    assert main.main(["params", path, "--json"]) == 0
    found = {p["path"]: p for p in json.loads(capsys.readouterr().out)["params"]}
    hammer = {"value": 2.5, "unit": "m/s", "range": "-10000 to 10000", "meaning": "velocity at time 0", "live": False}
    assert found["body.hammer.velocity"] == {"path": "body.hammer.velocity", "label": ""} | hammer
    assert found["contact.felt.stiffness"]["unit"] == "N/m^exponent"
    live = {p for p, row in found.items() if row["live"]}
    assert live >= {"contact.felt.stiffness", "contact.felt.gap", "body.string.frequency", "pickup.0.gain"}
    assert not live & {"seconds", "event.0.time", "contact.felt.exponent", "body.hammer.velocity"}
    assert found["event.0.time"]["value"] == 2.0 and found["seconds"]["value"] == 6.0
    assert main.main(["params", path]) == 0
    head, first, *rest = capsys.readouterr().out.splitlines()
    assert head.split() == ["path", "value", "unit", "range", "live", "meaning"]
    assert first.split()[:3] == ["seconds", "6", "s"] and len(rest) == len(found) - 1


@pytest.mark.hard_but(
    "templates-bar", "patches-bouncing_ball", "patches-bowed_violin", "patches-piano_c4", "patches-driven_ball"
)
@pytest.mark.parametrize("path", [*PATCHES, *TEMPLATES], ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_params_lead_to_the_numbers_of_the_file(path):
    """Each path, followed through the file as it is written, ends at the value, its own or that of its material. What
    the file leaves at its default is listed only if it can be changed while it sounds; and nothing is left out."""
    data = tomllib.loads(path.read_text("utf-8"))
    if is_instrument(data):  # as it is written out
        data = {name: table for name, table in expand(data).document.items() if name not in OWN_TABLES}
    data, _ = expand_bows(fill_in_values(data)[0], False, {})
    data = fill_in_materials(data)
    data.pop("vary", None)
    found = list_parameters(engine.load(path))
    given = {p: value for p in found if (value := follow(data, p.path.split("."))) is not None}
    named = {p for p in given if p.path.startswith("values.")}  # some of them have a unit
    assert all((p.value == value or p in named) and p.range for p, value in given.items())
    assert all(p.live for p in found if p not in given)
    data.pop("values", None)
    assert len(given) - len(named) == count(data) or is_instrument(tomllib.loads(path.read_text("utf-8")))
    one_by_one = {
        p.path.rpartition(".")[0] for p in found
    }  # the numbers of a list, which move together while it sounds
    shaped = {f"contact.{t.get('name')}.barrier" for t in data.get("contact", ()) if {"frets", "bridge"} & set(t)}
    assert {p.path for p in found if p.live} == set(live_paths(engine.load(path))) - shaped - one_by_one


def follow(node: object, steps: list[str]) -> object:
    """What a path leads to in a file, None if it is not there. Tables are named by their names or numbers."""
    for step in steps:
        if isinstance(node, list):
            named = [part for part in node if isinstance(part, dict) and part.get("name") == step]
            node = named[0] if named else node[int(step)]
        else:
            node = node.get(step)
    return node


def count(node: object) -> int:
    """Numbers within a value."""
    if isinstance(node, dict | list):
        return sum(map(count, node.values() if isinstance(node, dict) else node))
    return isinstance(node, int | float)


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda p: p.stem)
def test_templates_are_short_good_and_commented(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.main(["new", "mine", "--like", path.stem]) == 0
    told = capsys.readouterr().out
    assert "check mine.toml" in told and told.endswith("mine.toml\n")
    lines = Path("mine.toml").read_text("utf-8").splitlines()
    assert len(lines) < 65
    assert (tmp_path / lines[0].removeprefix("#:schema ")).samefile(SCHEMA)
    for line in lines:
        numeric = "=" in line and not line.startswith("#") and line.partition("= ")[2][:1] in "-[{0123456789"
        key = line.partition(" =")[0]
        assert not numeric or "#" in line or key in DIMENSIONLESS, f"no unit: {line}"
    assert main.main(["check", "mine.toml"]) == 0
    assert engine.load("mine.toml").seconds <= 6.0


@pytest.mark.hard
@pytest.mark.parametrize("path", TEMPLATES, ids=lambda p: p.stem)
def test_templates_sound_at_once(path):
    rendering = engine.render(engine.load(path), seconds=0.5)
    assert rendering.stats["peak"] > 1e-3 and rendering.stats["newton"]["unconverged"] == 0
    assert rendering.stats["energy"]["error_max"] < 1e-11


@pytest.mark.hard_for("piano-keys0", "guitar-keys1", "kalimba-keys2")
@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("piano", ["C2", "A4", "C6"]),
        ("guitar", ["E2", "G4", "E5"]),
        ("kalimba", ["C4", "E5"]),
        ("marimba", ["C3", "C6"]),
        ("drum", []),
    ],
)
def test_templates_of_instruments_sound_and_are_in_tune(name, keys):
    scene = engine.load(ROOT / "patches" / "templates" / f"{name}.toml")
    phrase = engine.render(scene, seconds=0.3)
    assert phrase.stats["peak"] > 1e-3 and phrase.stats["energy"]["error_max"] < 1e-10 and phrase.stats["trusted"]
    for key in keys:
        note = engine.render(scene_of_note(scene, key, 100, 1.2, 1.2))
        heard = features(note.audio, note.samplerate)["fundamental_hz"]
        assert abs(1200 * math.log2(heard / note_frequency(parse_key(key)))) < 12.0, key
        assert note.stats["energy"]["error_max"] < 1e-10


def test_new_overwrites_nothing_and_knows_its_templates(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main.main(["new", "a"]) == 0
    assert (
        "written from the template hammer; other templates for --like: ball, bar, bottle, bowl, bridge, chain, coin,"
        in capsys.readouterr().out
    )
    Path("a.toml").write_text("precious")
    assert main.main(["new", "a.toml"]) == 2
    assert "a.toml: already exists; give another NAME" in capsys.readouterr().err
    assert Path("a.toml").read_text() == "precious"
    assert main.main(["new", "b", "--like", "hamer"]) == 2
    assert 'no template "hamer"; did you mean "hammer"? There are ball, bar,' in capsys.readouterr().err
    assert main.main(["new", "b", "--like", "theremin"]) == 2
    assert 'no template "theremin"; ball, bar, bottle' in capsys.readouterr().err
    assert main.main(["new", "no/b"]) == 2
    assert "no such folder: no" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["a.toml"]
