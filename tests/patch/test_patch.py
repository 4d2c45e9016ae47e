"""Bad patches are refused with all their faults at once, located."""

import re

import numpy as np
import pytest
import soundfile
from conftest import PATCHES, ROOT

import engine
from engine.analysis.undamped import undamped_modes
from engine.assembly.build import build
from engine.cli import main
from engine.patch.toml_lines import locate_keys, nearest_line

GOOD = """title = "A ball"
seconds = 1.0

[[body]]
name = "ball"
kind = "mass"
mass = 1.0

[[contact]]
body = "ball"
barrier = 0.0
stiffness = 1e6
exponent = 1.5

[[pickup]]
body = "ball"
"""


def faults(tmp_path, text: str) -> list[str]:
    """What is said of a patch, without the file's name."""
    path = tmp_path / "p.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(engine.PatchError) as error:
        engine.load(path)
    lines = str(error.value).splitlines()
    assert all(line.startswith(str(path)) for line in lines)
    return [line.removeprefix(str(path)) for line in lines]


def test_the_good_patch_is_good(tmp_path):
    (tmp_path / "p.toml").write_text(GOOD)
    assert engine.load(tmp_path / "p.toml").body[0].mass == 1.0


@pytest.mark.parametrize("path", PATCHES, ids=lambda p: p.stem)
def test_shipped_patches_load_and_survive_a_round_trip(path):
    scene = engine.load(path)
    assert engine.Scene.model_validate(scene.model_dump()).model_dump() == scene.model_dump()
    assert scene.instrument or engine.Scene.model_validate(scene.model_dump()) == scene


def change(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


@pytest.mark.parametrize(
    ("text", "line", "path", "says"),
    [
        (change("mass = 1.0", "mas = 1.0"), 7, "body[0].mas", 'unknown key; did you mean "mass"?'),
        (change("mass = 1.0", "masse = 1.0"), 7, "body[0].masse", 'did you mean "mass"?'),
        (change("mass = 1.0", 'mass = "heavy"'), 7, "body[0].mass", '"heavy" is not a number; mass, kg'),
        (change("mass = 1.0", "mass = true"), 7, "body[0].mass", "true is not a number"),
        (change("mass = 1.0\n", ""), 4, "body[0].mass", "this key is missing; give it: mass, kg"),
        (change("mass = 1.0", "mass = 0"), 7, "body[0].mass", "0 is out of range; mass, kg"),
        (change("mass = 1.0", "mass = -1.0"), 7, "body[0].mass", "out of range"),
        (change("mass = 1.0", "mass = nan"), 7, "body[0].mass", "not a finite number"),
        (change("mass = 1.0", "mass = inf"), 7, "body[0].mass", "not a finite number"),
        (change("mass = 1.0", "mass = 1.0\ndamping_rate = -1"), 8, "body[0].damping_rate", "out of range"),
        (change('kind = "mass"', 'kind = "ball"'), 6, "body[0].kind", 'unknown kind "ball"'),
        (change('kind = "mass"', ""), 4, "body[0]", "kind is missing; give one of mass, oscillator"),
        (GOOD + '\n[[body]]\nname = "2nd"\nkind = "mass"\nmass = 2\n', 19, "body[1].name", '"2nd" is not a name'),
        (change("stiffness = 1e6", "stiffness = -1e6"), 12, "contact[0].stiffness", "out of range"),
        (change("stiffness = 1e6", "stifness = 1e6"), 12, "contact[0].stifness", 'did you mean "stiffness"?'),
        (change("exponent = 1.5", "exponent = 0.9"), 13, "contact[0].exponent", "0.9 is out of range; exponent α"),
        (change("exponent = 1.5", "exponent = 1.5\nloss = -1"), 14, "contact[0].loss", "out of range"),
        (change("barrier = 0.0", ""), 9, "contact[0]", "neither barrier nor on is given"),
        (change("barrier = 0.0", 'on = "wall"'), 11, "contact[0].on", 'no body is named "wall"; the bodies are "ball"'),
        (change("barrier = 0.0", 'on = "ball"'), 11, "contact[0].on", "a body cannot touch itself"),
        (change("barrier = 0.0", "barrier = 0.0\ngap = 1"), 12, "contact[0].gap", "gap is given without on"),
        (change('[[contact]]\nbody = "ball"', '[[contact]]\nbody = "bal"'), 10, "contact[0].body", "no body is named"),
        (change('[[pickup]]\nbody = "ball"', '[[pickup]]\nbody = "x"'), 16, "pickup[0].body", 'no body is named "x"'),
        (change('[[pickup]]\nbody = "ball"', ""), 1, "pickup", "this key is missing; give it: outputs of the scene"),
        (change("seconds = 1.0", "seconds = 0"), 2, "seconds", "0 is out of range"),
        (change('title = "A ball"', 'title = "A ball'), 1, None, "not valid TOML"),
        (GOOD + '\n[[body]]\nname = "ball"\nkind = "mass"\nmass = 2\n', 19, "body[1].name", 'the name "ball" is taken'),
        (
            GOOD + '\n[[force]]\nbody = "ball"\nkind = "file"\nfile = "no.wav"\namplitude = 1\n',
            21,
            "force[0].file",
            "no such file",
        ),
        (
            GOOD + '\n[[force]]\nbody = "ball"\nkind = "pulse"\namplitude = 1\n',
            18,
            "force[0].duration",
            "this key is missing; give it: duration",
        ),
        (GOOD + 'quantity = "volume"\n', 17, "pickup[0].quantity", '"volume" is not known; expected'),
        (
            GOOD + '\n[[body]]\nname = "o"\nkind = "oscillator"\nmass = 2\n',
            18,
            "body[1]",
            "neither stiffness nor frequency is given",
        ),
    ],
)
def test_one_fault_is_located_and_explained(tmp_path, text, line, path, says):
    found = faults(tmp_path, text)
    assert len(found) == 1, found
    assert found[0].startswith(f":{line} {path}: " if path else f":{line}: "), found
    assert says in found[0]


STRING = """[[body]]
name = "s"
kind = "string"
length = 1.0
linear_density = 1e-3
tension = 50.0

[[body]]
name = "drum"
kind = "membrane"
radius = 0.2
area_density = 0.3
frequency = 400.0

[[body]]
name = "ball"
kind = "mass"
mass = 1e-3

[[pickup]]
body = "s"
at = 0.9

[[contact]]
name = "c"
body = "s"
stiffness = 1e6
exponent = 1.5
"""
BAR = '[[body]]\nname = "b"\nkind = "bar"\nlength = 1\nmass = 1\nfrequency = 9\nratios = [1, 4, 3]\n\n'
AT = "at = 0.3\nbarrier = 0.0\n"
PUSH = '[[force]]\nkind = "constant"\namplitude = 1.0\nbody = "s"\nat = {}\n'


@pytest.mark.parametrize(
    ("text", "path", "says"),
    [
        (STRING.replace("at = 0.9", "at = 1.5") + AT, "pickup[0].at", "1.5 is not a position on a body"),
        (STRING.replace("at = 0.9", "at = nan") + AT, "pickup[0].at", "nan is not a position on a body"),
        (STRING.replace("at = 0.9", "") + AT, "pickup[0]", 'no position on "s"; give at = a fraction of its length'),
        (STRING.replace("at = 0.9", 'at = "middle"') + AT, "pickup[0].at", '"middle" is not a position on "s"'),
        (STRING + AT + PUSH.format("[0.1, 0.2]"), "force[0].at", "several positions; give one"),
        (STRING.replace("tension = 50.0", "tension = 0.0") + AT, "body[0].tension", "0.0 is out of range; tension, N"),
        (
            STRING.replace("area_density = 0.3", "area_density = 0.3\nsize = [0.1]") + AT,
            "body[1]",
            "both radius and size",
        ),
        (STRING.replace("radius = 0.2", "size = [0.1]") + AT, "body[1].size", "the list has 1 item; give at least 2"),
        (STRING.replace("tension", "t60 = 3.0\ntension") + AT, "body[0].t60", "3.0 is not a list; write t60 = [ … ]"),
        (STRING + "at = -0.1\nbarrier = 0.0\n", "contact[0].at", "-0.1 is not a position on a body"),
        (STRING + "at = []\nbarrier = 0.0\n", "contact[0].at", "[] is not a position on a body"),
        (STRING + "at = 0.3\nbarrier = nan\n", "contact[0].barrier", "nan is not a position; give a number in m"),
        (STRING + 'at = 0.3\nbarrier = "0.1"\n', "contact[0].barrier", '"0.1" is not a position; give a number in m'),
        (STRING + "at = [0.1, 0.2, 0.3]\nbarrier = [0.0, 0.1]\n", "contact[0].barrier", "2 numbers for 3 position(s)"),
        (STRING + 'at = 0.3\non = "s"\non_at = 0.3\n', "contact[0].on", "cannot touch itself at one position"),
        (
            STRING + 'at = [0.3, 0.4]\non = "s"\non_at = [0.5, 0.4]\n',
            "contact[0].on",
            "cannot touch itself at one position",
        ),
        (
            STRING + 'at = 0.3\non = "drum"\non_at = 0.5\n',
            "contact[0].on_at",
            '0.5 is not a position on "drum"; [x, y]',
        ),
        (
            STRING + 'at = 0.3\non = "drum"\non_at = [0.1, 0.1]\n',
            "contact[0].on_at",
            "[0.1, 0.1] lies outside the circle",
        ),
        (
            STRING + 'at = 0.3\non = "ball"\non_at = 0.5\n',
            "contact[0].on_at",
            '"ball" is a mass, which has no positions',
        ),
        (
            STRING + "bridge = { at = 5e-4, width = 2e-3 }\n",
            "contact[0].bridge.width",
            "the bridge extends beyond the end",
        ),
        (STRING + "bridge = { at = 0.1, widht = 2e-3 }\n", "contact[0].bridge.widht", 'did you mean "width"?'),
        (
            STRING + "bridge = [0.1, 2e-3]\n",
            "contact[0].bridge",
            "is not a table; write bridge = { at = …, width = … }",
        ),
        (STRING + AT + "bridge = { at = 0.1, width = 2e-3 }\n", "contact[0].at", "bridge and at are both given"),
        (STRING + "frets = { count = 5, height = [1, 2, 3] }\n", "contact[0].frets.height", "3 heights for 5 frets"),
        (
            STRING + "frets = { at = [], height = -1e-3 }\n",
            "contact[0].frets.at",
            "the list has 0 items; give at least 1",
        ),
        (
            STRING + AT + '[[event]]\ntime = 1\nkind = "change"\ncontact = "d"\ngap = 1\n',
            "event[0].contact",
            'named "d"',
        ),
        (STRING + AT + '[[event]]\ntime = 1\nkind = "change"\ncontact = "c"\n', "event[0]", "nothing changes; give"),
        (STRING + AT + '[[event]]\ntime = 1\nkind = "change"\ncontact = "c"\ngap = 1\n', "event[0].gap", "has no gap"),
        (
            STRING + AT + '[[event]]\ntime = 1\nkind = "strike"\nbody = "s"\nvelocity = 1\n',
            "event[0].body",
            "is a string",
        ),
        (
            STRING + AT + '[[force]]\nbody = "s"\nkind = "pluck"\nat = 2\namplitude = 1\nduration = 1\n',
            "force[0].at",
            "2 is not a position on a body",
        ),
        (STRING.replace("[[pickup]]", BAR + "[[pickup]]") + AT, "body[3].ratios", "these do not rise from 1"),
    ],
)
def test_faults_of_bodies_with_many_modes(tmp_path, text, path, says):
    found = faults(tmp_path, text)
    assert any(re.match(rf":\d+ {re.escape(path)}: ", f) and says in f for f in found), found


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("freq,p\n100,1\n", 'no column frequency; its columns are "freq", "p"'),
        ("frequency,p\n100\n", "mode 1 has 1 entries, the header 2"),
        ("frequency,p\n100,x\n", 'mode 1: p is "x", not a number'),
        ("frequency,p,p\n100,1,2\n", 'two columns are named "p"'),
        ("", "it needs a header and at least one mode"),
    ],
)
def test_a_faulty_table_of_modes_is_one_fault(tmp_path, table, says):
    (tmp_path / "m.csv").write_text(table)
    found = faults(tmp_path, '[[body]]\nname = "m"\nkind = "modes"\nfile = "m.csv"\n[[pickup]]\nbody = "m"\nat = "p"\n')
    assert len(found) == 1
    assert found[0].startswith(":4 body[0].file: cannot be read as CSV")
    assert says in found[0]


def test_all_faults_are_told_at_once(tmp_path):
    """Structure, ranges and references together, in the order of the file."""
    text = (
        GOOD.replace("seconds = 1.0", "secnds = 1.0")
        .replace("mass = 1.0", "mass = -1")
        .replace('[[contact]]\nbody = "ball"', '[[contact]]\nbody = "boll"')
        .replace("exponent = 1.5", "exponent = 0")
        .replace('[[pickup]]\nbody = "ball"', '[[pickup]]\nbody = "bell"')
    )
    found = faults(tmp_path, text)
    assert [f.split(" ")[0] for f in found] == [":2", ":7", ":10", ":13", ":16"]


def test_an_unreadable_force_file_is_a_fault(tmp_path):
    (tmp_path / "noise.wav").write_bytes(b"not a wav at all")
    text = GOOD + '\n[[force]]\nbody = "ball"\nkind = "file"\nfile = "noise.wav"\namplitude = 1\n'
    assert "cannot be read as audio" in faults(tmp_path, text)[0]
    soundfile.write(tmp_path / "noise.wav", np.zeros((10, 2)), 44_100)
    assert "the file has 2 channel(s)" in faults(tmp_path, text + "channel = 3\n")[0]


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", None])
def test_what_is_not_a_patch(tmp_path, content):
    path = tmp_path / "p.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(engine.PatchError, match=r"no such file|not a text file"):
        engine.load(path)


@pytest.mark.parametrize(
    "rest", ["frets = { count = 12, height = -1e-3 }", "bridge = { at = 0.1, width = 2e-3, height = -1e-3 }"]
)
def test_frets_and_bridges_lie_under_the_string(tmp_path, rest):
    """So that it hangs free over them; and above it only where the patch says so."""
    path = tmp_path / "patch.toml"
    path.write_text(STRING + rest + "\n", "utf-8")
    assert engine.load(path).contact[0].side == "below"
    assert engine.render(engine.load(path), seconds=0.001).stats.energy.initial == 0.0
    path.write_text(STRING + rest + '\nside = "above"\n', "utf-8")
    assert engine.load(path).contact[0].side == "above"


def test_a_check_says_which_contact_begins_compressed(tmp_path, capsys):
    """With the energy of its law, k·xᵅ⁺¹/(α+1): here of a string that begins 1 mm inside two frets."""
    path = tmp_path / "patch.toml"
    path.write_text(STRING + 'frets = { at = [0.3, 0.6], height = -1e-3 }\nside = "above"\n', "utf-8")
    assert main.main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert f"contact[0] begins with a compression of 0.001 m, whose energy is {2 * 1e6 * 1e-3**2.5 / 2.5:.3g} J" in said
    path.write_text(STRING + "frets = { at = [0.3, 0.6], height = -1e-3 }\n", "utf-8")
    assert main.main(["check", str(path)]) == 0
    assert "compression" not in capsys.readouterr().out


NO_LOSS = {"kind": "oscillator", "mass": 0.01}
JOINT = {"name": "joint", "kind": "spring", "body": "low", "on": "high", "stiffness": 1e3}


@pytest.mark.parametrize(
    ("tables", "counts"),
    [
        ({}, {"low": 1, "high": 1}),
        ({"connection": [JOINT]}, {"low": 1, "high": 1}),
        ({"connection": [JOINT | {"damping_coefficient": 0.1}]}, {}),
        ({"event": [{"kind": "damp", "time": 0.1, "body": "low", "sigma": 5.0}]}, {"high": 1}),
        ({"connection": [JOINT], "event": [{"kind": "damp", "time": 0.1, "body": "low", "sigma": 5.0}]}, {}),
        (
            {
                "connection": [JOINT],
                "event": [{"kind": "change", "time": 0.1, "connection": "joint", "damping_coefficient": 0.1}],
            },
            {},
        ),
    ],
)
def test_a_check_says_what_never_decays_and_so_it_does(tables, counts):
    """Against the energy that is left after two seconds: none of what is damped, from the start or later."""
    bodies = [
        NO_LOSS | {"name": name, "frequency": f, "velocity": 1.0} for name, f in (("low", 200.0), ("high", 290.0))
    ]
    pickups = [{"body": body["name"], "channel": n + 1} for n, body in enumerate(bodies)]
    scene = engine.Scene.model_validate({"body": bodies, "pickup": pickups} | tables)
    assert undamped_modes(build(scene, 44_100).layout) == counts
    audio = engine.render(scene, seconds=3.0).audio
    left = np.abs(audio[-4410:]).max(axis=0) / np.abs(audio[:4410]).max(axis=0)
    assert [name for name, ratio in zip(("low", "high"), left, strict=True) if ratio > 0.9] == [*counts]


def test_faults_of_a_scene_from_python():
    with pytest.raises(ValueError, match="no body is named"):
        engine.Scene.model_validate({"body": [], "pickup": [{"body": "x"}]})


def test_lines_of_keys():
    text = 'a = 1\n[b]\nc = [\n 1,\n 2]\n"d.e" = {f = 1}\n[[g]]\nh.i = """\n[x]\n"""\n[[g.j]]\nk = 1\n'
    text += "[[g]]\nh = 2\n[[g.j]]\nk = 2\n"
    lines = locate_keys(text)
    assert lines[("a",)] == 1
    assert lines[("b",)] == 2
    assert lines[("b", "c")] == 3
    assert nearest_line(lines, ("b", "c", 1)) == 3
    assert nearest_line(lines, ("b", "d.e", "f")) == 6
    assert lines[("g", 0, "h", "i")] == 8
    assert lines[("g", 0, "j", 0, "k")] == 12
    assert lines[("g", 1, "h")] == 14
    assert lines[("g", 1, "j", 0, "k")] == 16


def test_arguments_out_of_range_are_refused(patch):
    scene = patch("bouncing_ball")
    for wrong in ({"seconds": 0}, {"seconds": float("nan")}, {"samplerate": 10}, {"scheme": "magic"}):
        with pytest.raises(ValueError, match=r"out of range|unknown scheme"):
            engine.render(scene, **wrong)


def test_a_body_too_fast_for_the_rate_is_refused(patch):
    """The exact table needs frequencies below Nyquist; the paper's does not."""
    scene = patch("repelled_oscillator")
    dump = scene.model_dump(exclude_none=True)
    dump["body"][0]["frequency"] = 30_000.0
    fast = engine.Scene.model_validate(dump)
    with pytest.raises(ValueError, match=r"vibrates at 30000 Hz.*--samplerate 61225"):
        engine.render(fast)
    assert engine.render(fast, seconds=0.1, scheme="fdh").stats["energy"]["error_max"] < 1e-12
    assert (ROOT / "patches").is_dir()
