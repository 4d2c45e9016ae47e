"""Sets of sampled notes: the sounds, their levels and names, their SFZ file, and what is refused."""

import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import soundfile
from sweeps import Alone, rows

import engine
from engine.cli import main
from engine.instrument.key_names import note_frequency, parse_key
from engine.patch.note_scene import scene_of_note
from engine.sweep import sweep as sweep_module
from engine.sweep.note_axes import parse_notes, parse_velocities, release_time, scene_with_note
from engine.sweep.plan import SweepPlan, grid_points
from engine.sweep.sfz import nearest_ranges
from engine.sweep.task import RenderResult

LYRE = """
title = "Lyre"

[keyboard]
keys = "C3..C5"

[keyboard.values]
length = { C3 = 0.7, C5 = 0.2 }
hard = 1.0

[[key.body]]
name = "string"
kind = "string"
length = "= length"
linear_density = 2e-3
frequency = "= f"
t60 = [2.0, 0.5]
t60_at = [100.0, 3000.0]
modes = 16

[[key.on]]
kind = "pluck"
body = "string"
at = 0.2
amplitude = "= hard * (0.1 + v)"
duration = 2e-3

[[key.damper]]
keys = "C3..B4"
body = "string"
sigma = 50.0

[[key.pickup]]
body = "string"
at = 0.9
"""
NOTES = ["--notes", "C3,F#4", "--velocities", "40,127", "--seconds", "0.4", "--hold", "0.3"]
PCM = [*NOTES, "--subtype", "PCM_24"]  # files without the time, which libsndfile writes into those of FLOAT
NAMES = ["lyre_C3_v040.wav", "lyre_C3_v127.wav", "lyre_Fs4_v040.wav", "lyre_Fs4_v127.wav"]


@pytest.fixture
def lyre(tmp_path) -> str:
    (tmp_path / "lyre.toml").write_text(LYRE, "utf-8")
    return str(tmp_path / "lyre.toml")


def sampled(patch: str, folder: Path, *words: str, cores: str = "1") -> int:
    return main.main(["sweep", patch, "-o", str(folder), "--cores", cores, *words])


@pytest.fixture
def alone(monkeypatch) -> Alone:
    """Renders in this process, in place of others."""
    renderer = Alone()
    monkeypatch.setattr(sweep_module, "run_local", lambda tasks, cores: renderer(tasks))
    return renderer


def read_sfz(path: Path) -> list[dict[str, str]]:
    """The regions, each with what it inherits from the headers above it."""
    text = re.sub(r"//.*", "", path.read_text("utf-8"))
    levels = {"<control>": 0, "<global>": 1, "<group>": 2, "<region>": 3}
    opcodes: list[dict[str, str]] = [{}, {}, {}, {}]
    regions, level = [], 0
    for word in text.split():
        if word in levels:
            level = levels[word]
            opcodes[level:] = [{} for _ in opcodes[level:]]
            regions += [(opcodes[0], opcodes[1], opcodes[2], opcodes[3])] if level == 3 else []
        else:
            key, _, value = word.partition("=")
            opcodes[level][key] = value
    return [control | common | group | region for control, common, group, region in regions]


def matching(regions: list[dict[str, str]], key: int, velocity: int) -> list[dict[str, str]]:
    def holds(region: dict[str, str]) -> bool:
        is_key = int(region["lokey"]) <= key <= int(region["hikey"])
        return is_key and int(region["lovel"]) <= velocity <= int(region["hivel"])

    return [region for region in regions if holds(region)]


# --- sounds


def test_a_set_has_the_sounds_of_single_notes_at_one_gain(lyre, tmp_path, alone, capsys):
    folder = tmp_path / "set"
    assert sampled(lyre, folder, *NOTES, "--subtype", "DOUBLE", "--no-fade", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["points"], told["done"], told["failed"]) == (4, 4, 0) and "sfz" not in told
    found = rows(folder)
    assert [row["file"] for row in found] == NAMES
    assert {path.name for path in folder.iterdir()} == {*NAMES, "index.csv"}
    assert [(row["note"], row["velocity"]) for row in found[1:3]] == [("C3", "127"), ("F#4", "40")]
    peaks = []
    for row in found:
        scene = scene_of_note(engine.load(lyre), row["note"], int(row["velocity"]), 0.3, 0.4)
        expected = engine.render(scene, samplerate=44_100)
        audio, rate = soundfile.read(folder / row["file"], always_2d=True)
        assert rate == 44_100 and len(audio) == 17_640
        np.testing.assert_array_equal(audio, expected.audio * 10 ** (told["gain_db"] / 20))
        assert float(row["gain_db"]) == pytest.approx(told["gain_db"], rel=1e-8)
        assert float(row["peak"]) == pytest.approx(expected.stats["peak"], rel=1e-8)
        assert float(row["energy_error"]) < 1e-12
        heard = float(row["fundamental_hz"])
        assert abs(1200 * math.log2(heard / note_frequency(parse_key(row["note"])))) < 5.0
        peaks.append(np.abs(audio).max())
    assert max(peaks) == pytest.approx(10 ** (-1 / 20), rel=1e-8)


@pytest.mark.hard
def test_files_are_the_same_on_two_processes(lyre, tmp_path):
    assert sampled(lyre, tmp_path / "one", *PCM, "--sfz") == 0
    assert sampled(lyre, tmp_path / "two", *PCM, "--sfz", cores="2") == 0
    assert len([*(tmp_path / "one").iterdir()]) == 6
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


@pytest.mark.hard
def test_a_set_that_was_stopped_goes_on_and_ends_the_same(lyre, tmp_path, alone):
    assert sampled(lyre, tmp_path / "whole", *PCM) == 0
    alone.given, alone.most = [], 3
    folder = tmp_path / "set"
    assert sampled(lyre, folder, *PCM, "--sfz") == 130
    assert not list(folder.glob("*.wav")) and not list(folder.glob("*.sfz"))
    assert len(list((folder / "unscaled").iterdir())) == 3
    (folder / "unscaled" / ".lyre_C3_v040.wav.7.part").write_bytes(b"half")
    alone.given, alone.most = [], math.inf
    assert sampled(lyre, folder, *PCM) == 0
    assert alone.given == [4]
    same(folder, tmp_path / "whole")
    (folder / NAMES[1]).unlink()  # the loudest
    alone.given = []
    assert sampled(lyre, folder, *PCM) == 0
    assert alone.given == [2]
    same(folder, tmp_path / "whole")
    alone.given = []
    assert sampled(lyre, folder, *PCM, "--sfz") == 0  # needs no sound anew
    assert alone.given == [] and (folder / "lyre.sfz").exists()


def same(folder: Path, other: Path) -> None:
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == {p.name: p.read_bytes() for p in other.iterdir()}


@pytest.mark.hard
def test_sounds_of_another_gain_are_rendered_again(lyre, tmp_path, alone, monkeypatch):
    """The loudest failed at first; when it does not, the gain is another one."""
    folder, failed = tmp_path / "set", RenderResult(None, {}, "no memory")

    def run_local(tasks, cores):
        yield from ((n, failed if n == 2 else result) for n, result in alone(tasks))

    monkeypatch.setattr(sweep_module, "run_local", run_local)
    assert sampled(lyre, folder, *PCM) == 1
    first = float(rows(folder)[0]["gain_db"])
    monkeypatch.setattr(sweep_module, "run_local", lambda tasks, cores: alone(tasks))
    assert sampled(lyre, folder, *PCM) == 1  # three of them have the gain of before
    assert sampled(lyre, folder, *PCM) == 0
    assert {float(row["gain_db"]) for row in rows(folder)} == {float(rows(folder)[3]["gain_db"])} != {first}
    assert sampled(lyre, tmp_path / "whole", *PCM) == 0
    same(folder, tmp_path / "whole")


def test_notes_are_axes_beside_others(lyre, tmp_path, alone, capsys):
    words = ["--vary", "keyboard.values.hard=1,2", "--notes", "A3", "--seconds", "0.1", "--gain", "0"]
    assert sampled(lyre, tmp_path / "set", *words) == 0
    one, two = rows(tmp_path / "set")
    assert (one["file"], two["file"]) == ("0001_values_hard_1_A3_v080.wav", "0002_values_hard_2_A3_v080.wav")
    assert (one["velocity"], one["gain_db"], two["keyboard.values.hard"]) == ("80", "0", "2")
    assert float(two["peak"]) == pytest.approx(2 * float(one["peak"]), rel=1e-6)


def test_a_patch_without_a_keyboard_is_tuned_as_its_voices_are(tmp_path, alone):
    """The piano's hammer is faster by (v/64)^1.5, and its string has the pitch of the note."""
    words = ["--notes", "C4,A4", "--velocities", "64,127", "--seconds", "0.5", "--hold", "0.3", "--gain", "0"]
    assert sampled("piano_c4", tmp_path / "set", *words) == 0
    found = rows(tmp_path / "set")
    for row in found:
        heard = float(row["fundamental_hz"])
        assert abs(1200 * math.log2(heard / note_frequency(parse_key(row["note"])))) < 5.0
        audio = soundfile.read(tmp_path / "set" / row["file"])[0]
        assert np.abs(audio[-2000:]).max() < 0.1 * np.abs(audio[11_000:13_000]).max()  # damped at 0.3 s
    assert float(found[1]["peak"]) > 2.0 * float(found[0]["peak"])


# --- SFZ


@pytest.mark.hard
def test_every_key_and_velocity_has_one_region(lyre, tmp_path, alone, capsys):
    folder = tmp_path / "set"
    words = ["--notes", "C3..C5/11", "--velocities", "3", "--sfz", "--seconds", "0.1", "--hold", "0.05"]
    assert sampled(lyre, folder, *words) == 0
    assert capsys.readouterr().out.endswith(f"{folder / 'lyre.sfz'}\n")
    regions = read_sfz(folder / "lyre.sfz")
    assert len(regions) == 12
    for key in range(parse_key("C3"), parse_key("C5") + 1):
        for velocity in range(1, 128):
            (region,) = matching(regions, key, velocity)
            assert (folder / region["sample"]).is_file() and region["amp_veltrack"] == "0"
            centre = int(region["pitch_keycenter"])
            assert abs(key - centre) == min(abs(key - k) for k in (48, 59, 70, 72))
            release = float(region["ampeg_release"])
            assert release == pytest.approx(8.0 / 50.0 if centre < 72 else 0.1, rel=1e-2)
    assert not matching(regions, parse_key("B2"), 64) and not matching(regions, parse_key("C#5"), 64)
    (top,) = matching(regions, 48, 127)
    assert top["sample"] == "lyre_C3_v127.wav"


@pytest.mark.parametrize(("name", "key"), [("guitar", "E2"), ("guitar", "E3"), ("piano", "C4"), ("vibraphone", "F3")])
def test_a_player_lets_a_note_fall_as_its_dampers_do(name, key):
    """ARIA falls by 69 dB in the release of SFZ, sfizz by 78; a damper of σ by 8.686 σ in a second."""
    scene = scene_with_note(engine.load(name), key, 80, 0.5, 1.0)
    (sigma,) = {event.sigma for event in scene.event if event.kind == "damp" and event.time == 0.5}
    assert 69.0 / release_time(scene, 0.5) == pytest.approx(8.686 * sigma, rel=0.01)
    assert 78.0 / release_time(scene, 0.5) == pytest.approx(8.686 * sigma, rel=0.13)


def test_notes_that_failed_are_left_to_their_neighbours(lyre, tmp_path, alone):
    axes = [parse_notes("C3,A3,A4", engine.load(lyre)), parse_velocities(None)]
    plan = SweepPlan(lyre, tomllib.loads(LYRE), axes, grid_points(axes))
    assert sampled(lyre, tmp_path / "set", "--notes", "C3,A3,A4", "--seconds", "0.05") == 0
    index = tmp_path / "set" / "index.csv"
    lines = index.read_text("utf-8").splitlines(keepends=True)
    index.write_text("".join([*lines[:2], lines[2].replace(",done,", ",broken,"), lines[3]]), "utf-8")
    regions = read_sfz(sweep_module.write_note_map(plan, tmp_path / "set"))
    assert [(region["lokey"], region["hikey"]) for region in regions] == [("48", "58"), ("59", "69")]


def test_ranges_of_the_nearest():
    assert nearest_ranges([60], 60, 60) == {60: (60, 60)}
    assert nearest_ranges([60, 63, 65], 58, 70) == {60: (58, 61), 63: (62, 64), 65: (65, 70)}


# --- what is asked for


def test_notes_and_velocities_are_read(lyre):
    scene = engine.load(lyre)
    assert parse_notes("C3..C5/5", scene).bounds == ("C3", "F3", "A#3", "D#4", "G#4", "C5")
    assert parse_notes("A3, C3..D3, Bb3", scene).bounds == ("C3", "C#3", "D3", "A3", "A#3")
    assert parse_velocities("8").bounds == (16, 32, 48, 64, 79, 95, 111, 127)
    assert parse_velocities("127").bounds == tuple(range(1, 128))
    assert parse_velocities("127,40").bounds == (40, 127)


@pytest.mark.hard
def test_a_range_is_of_the_keys_that_the_instrument_has(lyre, tmp_path, capsys):
    """Those that it has not are named; with white keys only, beyond its ends, in steps, and beside others."""
    white = tmp_path / "white.toml"
    keys = '["C3..E3", "F3", "G3", "A3", "B3"]'.replace("C3..E3", 'C3", "D3", "E3')
    damper = LYRE.index("[[key.damper]]"), LYRE.index("[[key.pickup]]")
    text = (LYRE[: damper[0]] + LYRE[damper[1] :]).replace('"C3..C5"', keys).replace("C5 = 0.2", "B3 = 0.2")
    white.write_text(text, "utf-8")
    left_out: list[str] = []
    assert parse_notes("C3..E3", engine.load(white), left_out).bounds == ("C3", "D3", "E3")
    assert left_out == ["notes: the instrument has no key C#3, D#3, which are left out"]
    assert parse_notes("A2..C#3, G3..A3", engine.load(white)).bounds == ("C3", "G3", "A3")
    assert parse_notes("C3..B3/2", engine.load(white)).bounds == ("C3", "D3", "E3", "B3")
    left_out.clear()
    assert parse_notes("C3,F3..F3", engine.load(white), left_out).bounds == ("C3", "F3") and not left_out
    words = ["--notes", "C3..D3", "--seconds", "0.02", "--hold", "0.01", "--json"]
    assert main.main(["sweep", str(white), "-o", str(tmp_path / "set"), *words]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["done"] == 2
    assert "note: notes: the instrument has no key C#3, which are left out\n" in told.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--notes", "H4"], '--notes: "H4" is not a key; a key such as "C4"'),
        (["--notes", "C3..C5/0"], '"C3..C5/0" is neither a key nor a range; give a range such as A0..C8'),
        (["--notes", "C3,,D3"], '"" is neither a key nor a range'),
        (["--notes", "C4..C3"], "goes downwards"),
        (["--notes", "B2,C3,D5"], "--notes: the instrument has no key B2, D5; C3 to C5"),
        (["--notes", "C6..G7"], "no key C6, C#6, D6, D#6, E6, F6, F#6, G6 and 12 more; C3 to C5"),
        (["--notes", "C3..D5,D#5"], "--notes: the instrument has no key D#5; C3 to C5"),
        (["--notes", "C4", "--velocities", "128"], '--velocities: "128" is neither a number of layers nor a list'),
        (["--notes", "C4", "--velocities", "40,40"], "40 is listed twice"),
        (["--notes", "C4", "--hold", "0"], "--hold: 0 is out of range; give more than 0, at most"),
        (["--notes", "C4", "--sfz", "--vary", "keyboard.values.hard=1,2"], "--sfz: requires all notes, one of each"),
        (["--notes", "C4", "--vary", "seconds=1,2"], "seconds: --hold and --seconds set the length of notes"),
        (["--sfz"], "--sfz: requires --notes; give a range such as A0..C8"),
        (["--velocities", "8"], "--velocities: requires --notes; give a range"),
        (["--vary", "keyboard.values.hard=1,2", "--hold", "1"], "--hold: requires --notes; give a range"),
        ([], "nothing varies; give --vary PATH=RANGE, or --notes A0..C8"),
        (["--vary", "body.C4_string.length=1,2"], "is not in the patch"),
    ],
)
def test_what_cannot_be_is_refused(lyre, tmp_path, capsys, words, says):
    assert main.main(["sweep", lyre, "-o", str(tmp_path / "set"), *words]) == 2
    said = capsys.readouterr().err
    assert says in said and "Traceback" not in said
    assert not (tmp_path / "set").exists()


def test_a_patch_that_has_no_pitch_says_so(tmp_path, capsys):
    assert main.main(["sweep", "bouncing_ball", "-o", str(tmp_path / "set"), "--notes", "C4"]) == 2
    assert "--notes: ball has no pitch to tune" in capsys.readouterr().err


def test_values_of_a_written_out_key_cannot_vary(lyre, tmp_path, capsys):
    """Its body is in the scene, but in the patch there is only the shared one."""
    Path(lyre).write_text(LYRE + '[[body]]\nname = "box"\nkind = "mass"\nmass = 1.0\n', "utf-8")
    assert main.main(["sweep", lyre, "-o", str(tmp_path / "set"), "--vary", "body.C4_string.length=1,2"]) == 2
    assert "it is written out for a key; change what is under key or keyboard.values" in capsys.readouterr().err


def test_other_things_and_other_sweeps_are_not_touched(lyre, tmp_path, alone, capsys):
    folder = tmp_path / "set"
    folder.mkdir()
    (folder / "mine.txt").write_text("precious")
    assert sampled(lyre, folder, *NOTES) == 2
    assert "has other files in it; give an empty folder" in capsys.readouterr().err
    (folder / "mine.txt").unlink()
    assert sampled(lyre, folder, "--vary", "keyboard.values.hard=1,2", "--seconds", "0.1") == 0
    assert sampled(lyre, folder, *NOTES) == 2
    assert "is an index of something else" in capsys.readouterr().err
