"""Variations of a patch: drawn as it says, named as an option says, each cut and brought to a level, on one page."""

import json
import statistics

import numpy as np
import pytest
import soundfile
from conftest import ROOT
from sweeps import MARBLE, rows

from engine.cli import main
from engine.sound.loudness import loudness_of
from engine.sweep.sound_names import fill_name, point_stem
from engine.sweep.task import render_task

BALLS = """
title = "Balls on a plate"
seconds = 1.5
[values]
radius = "3 cm"
mass = "= 4/3 * pi * radius**3 * 2500"
[vary]
radius = "0.01..0.05:log"
"body.ball.velocity" = "-2~0.2"
"contact.0.loss" = [0.05, 0.2]
seed = 3
[[body]]
name = "ball"
kind = "mass"
mass = "= mass"
displacement = 0.02
velocity = -2.0
[[body]]
name = "plate"
kind = "modes"
frequency = [310.0, 855.0, 1675.0]
sigma = [6.0, 10.0, 18.0]
points = { middle = [1.0, 0.8, 0.6] }
[[contact]]
body = "ball"
on = "plate"
on_at = "middle"
side = "above"
stiffness = 1e7
exponent = 1.5
loss = 0.1
[[pickup]]
body = "plate"
at = "middle"
"""
QUICK = "--seconds", "0.02"


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Sounds are rendered here: to start another process takes longer."""
    rendered = lambda tasks, cores: ((task.number, render_task(task)) for task in tasks)
    monkeypatch.setattr("engine.sweep.sweep.run_local", rendered)


@pytest.fixture
def balls(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "balls.toml").write_text(BALLS, "utf-8")
    return "balls.toml"


def sweep(*words: str) -> int:
    return main.main(["sweep", *words, "--cores", "1"])


def test_variations_are_drawn_as_the_patch_says(balls, tmp_path):
    assert sweep(balls, "--variations", "60", *QUICK) == 0
    found = rows(tmp_path / "balls")
    radii = [float(row["values.radius"]) for row in found]
    speeds = [float(row["body.ball.velocity"]) for row in found]
    assert all(0.01 <= radius <= 0.05 for radius in radii)
    assert statistics.median(radii) == pytest.approx((0.01 * 0.05) ** 0.5, rel=0.25)
    assert statistics.mean(speeds) == pytest.approx(-2.0, abs=0.1)
    assert statistics.stdev(speeds) == pytest.approx(0.2, rel=0.3)
    assert {row["contact.0.loss"] for row in found} == {"0.05", "0.2"}


def test_fewer_variations_are_the_first_of_more_and_a_seed_makes_others(balls, tmp_path):
    for folder, words in (("a", "4"), ("b", "8")):
        assert sweep(balls, "--variations", words, "-o", folder, *QUICK) == 0
    assert sweep(balls, "--variations", "4", "--seed", "4", "-o", "c", *QUICK) == 0
    drawn = {name: [row["values.radius"] for row in rows(tmp_path / name)] for name in "abc"}
    assert drawn["a"] == drawn["b"][:4] and not set(drawn["a"]) & set(drawn["c"])


def test_a_drawn_scene_that_is_none_is_drawn_again_and_counted(balls, tmp_path, capsys):
    text = BALLS.replace('radius = "0.01..0.05:log"', 'radius = "-0.05..0.05"')
    (tmp_path / "balls.toml").write_text(text, "utf-8")
    assert sweep(balls, "--variations", "12", *QUICK) == 0
    assert "drawn variations were no valid scenes, and were drawn again" in capsys.readouterr().err
    assert all(float(row["values.radius"]) > 0.0 for row in rows(tmp_path / "balls"))


def test_a_patch_that_says_nothing_of_what_varies_is_refused(capsys):
    assert sweep(MARBLE, "--variations", "3") == 2
    assert "the patch does not say what varies; write [vary]" in capsys.readouterr().err


def test_ranges_of_which_nothing_is_a_scene_are_refused(balls, tmp_path, capsys):
    text = BALLS.replace('radius = "0.01..0.05:log"', 'radius = "-0.05..-0.01"')
    (tmp_path / "balls.toml").write_text(text, "utf-8")
    assert sweep(balls, "--variations", "3") == 2
    assert "only 0 of" in capsys.readouterr().err


def test_forty_variations_begin_at_once_and_are_equally_loud(balls, tmp_path):
    """The sound designer's job: within 1 ms of 0, within half a loudness unit, none cut off."""
    words = "--trim", "--loudness", "-30", "--for", "unity", "--name", "PLATImpt_Ball_{number:02}"
    assert sweep(balls, "--variations", "40", *words, "--seconds", "1.5") == 0
    paths = sorted((tmp_path / "balls").glob("*.wav"))
    assert [path.name for path in paths][::39] == ["PLATImpt_Ball_01.wav", "PLATImpt_Ball_40.wav"]
    loudness = []
    for path in paths:
        audio, rate = soundfile.read(path, always_2d=True)
        size = np.abs(audio).max(axis=1)
        assert np.flatnonzero(size > 1e-2 * size.max())[0] / rate < 1e-3
        assert rate == 48_000 and soundfile.info(str(path)).subtype == "PCM_16"
        loudness.append(loudness_of(audio, rate))
    assert max(loudness) - min(loudness) < 0.5


def test_a_sweep_in_si_units_goes_on_under_other_names(tmp_path, capsys):
    """What is rendered is not rendered again because its name is another one."""
    words = MARBLE, "--vary", "body.marble.mass=0.002,0.004", "-o", str(tmp_path / "a"), *QUICK, "--json"
    assert sweep(*words) == 0
    before = {row["body.marble.mass"]: row for row in rows(tmp_path / "a")}
    capsys.readouterr()
    assert sweep(*words, "--name", "marble_{number}") == 0
    assert json.loads(capsys.readouterr().out)["before"] == 2
    after = {row["body.marble.mass"]: row for row in rows(tmp_path / "a")}
    assert {row["file"] for row in after.values()} == {"marble_1.wav", "marble_2.wav"}
    assert {m: row["peak"] for m, row in after.items()} == {m: row["peak"] for m, row in before.items()}
    assert sorted(path.name for path in (tmp_path / "a").glob("*.wav")) == ["marble_1.wav", "marble_2.wav"]


@pytest.mark.parametrize(
    ("template", "says"),
    [
        ("{nmber}", 'there is no field "nmber"; the fields are number, patch, marble.mass, body.marble.mass'),
        ("{number", "is not a name"),
        ("{number:zz}", "{number:zz} does not fit 1; give {number}"),
        ("a/{number}", "has '/' in it"),
        ("all", "two sounds would be called all.wav; add {number} to their names"),
        ("", "is empty"),
    ],
)
def test_a_wrong_template_is_refused_before_anything_is_rendered(tmp_path, capsys, template, says):
    words = MARBLE, "--vary", "body.marble.mass=0.002,0.004", "-o", str(tmp_path / "a"), "--name", template
    assert sweep(*words) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_names_hold_what_varies_without_signs_that_programs_stumble_over():
    assert (
        point_stem(1, [("contact.felt.stiffness", 1e7), ("body.b.mass", 0.05)]) == "0001_felt_stiffness_1e7_b_mass_0p05"
    )
    assert fill_name("x_{number:03}_{m:.2f}", {"number": 7, "m": 0.5}) == "x_007_0p50.wav"
    long = [(f"contact.felt_{n}.stiffness", 1.0 / 3.0) for n in range(9)]
    assert len(point_stem(1, long)) <= 76


def test_the_files_say_what_they_are(balls, tmp_path):
    wavinfo = pytest.importorskip("wavinfo")
    assert sweep(balls, "--variations", "1", *QUICK) == 0
    (path,) = (tmp_path / "balls").glob("*.wav")
    (row,) = rows(tmp_path / "balls")
    user = wavinfo.WavInfoReader(str(path)).ixml.parsed.find("USER")
    found = {value.get("NAME"): value.text for value in user.findall("FDH_VALUE")}
    assert found == {name: row[name] for name in ("values.radius", "body.ball.velocity", "contact.0.loss")}
    assert user.find("FDH_PATCH").text == BALLS


def test_a_sampler_gets_root_notes(tmp_path):
    import struct

    words = str(ROOT / "patches" / "kalimba_keys.toml"), "--notes", "A4", "-o", str(tmp_path / "k"), "--seconds", "0.05"
    assert sweep(*words, "--hold", "0.05") == 0
    (path,) = (tmp_path / "k").glob("*.wav")
    data = path.read_bytes()
    assert struct.unpack("<I", data[(at := data.index(b"smpl")) + 20 : at + 24])[0] == 69
