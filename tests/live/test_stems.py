"""Stems of a MIDI file: they are of one length, and together they are the mix."""

import json
import re

import mido
import numpy as np
import pytest
import soundfile
from test_midi_files import BASS, MELODY, RODS, write

from engine.cli import main

TEMPO = [
    (0.0, mido.MetaMessage("set_tempo", tempo=500_000)),
    (0.0, mido.MetaMessage("marker", text="begin")),
    (0.3, mido.MetaMessage("marker", text="verse")),
]
# of n parts: what the numbers of a format may differ by
ROUNDING = {"DOUBLE": 1e-15, "FLOAT": 2.0**-24, "PCM_24": 2.0**-23, "PCM_16": 2.0**-15}


@pytest.fixture
def song(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rods.toml").write_text(RODS, "utf-8")
    (tmp_path / "slow.toml").write_text(RODS.replace("damping_rate = 3.0", "damping_rate = 1.0"), "utf-8")
    later = [[(time + 0.5, message) for time, message in part] for part in (MELODY, BASS)]
    return write(tmp_path / "song.mid", TEMPO, *later)


def render(song, *words, subtype="DOUBLE"):
    """The mix, the stems by their names, and what is printed."""
    words = "rods.toml", "--midi", song, "--stems", "stems", "-o", "mix.wav", "--subtype", subtype, *words
    assert main.main(["render", *words, "--seconds", "0.8", "--json"]) == 0


def read(folder):
    return {path.stem: soundfile.read(path, always_2d=True)[0] for path in sorted((folder / "stems").glob("*.wav"))}


@pytest.mark.parametrize("subtype", ROUNDING)
@pytest.mark.parametrize("words", [("--play", "2=slow.toml@-6"), ()], ids=["two patches", "one patch"])
def test_stems_sum_to_the_mix(song, tmp_path, subtype, words):
    render(song, *words, subtype=subtype)
    mix, _ = soundfile.read("mix.wav", always_2d=True)
    stems = read(tmp_path)
    assert [re.sub(r"^\d+_", "", name) for name in stems] == ["Melody_rods", "Bass_slow" if words else "Bass_rods"]
    assert {len(stem) for stem in stems.values()} == {len(mix)} and all(stem.any() for stem in stems.values())
    peak = np.abs(mix).max() if subtype == "DOUBLE" else 1.0
    assert np.abs(sum(stems.values()) - mix).max() <= (len(stems) + 1) * ROUNDING[subtype] * peak


@pytest.mark.parametrize("words", [("--trim",), ("--loop", "0.1"), ("--no-fade",), ("--loudness", "-40")])
def test_they_are_cut_as_the_mix_is(song, tmp_path, words):
    render(song, *words)
    mix, _ = soundfile.read("mix.wav", always_2d=True)
    assert np.abs(sum(read(tmp_path).values()) - mix).max() <= 3e-15 * np.abs(mix).max()


def test_parts_of_one_patch_keep_their_balance(song, tmp_path):
    """They have the gain that they have when the patch plays both."""
    render(song, "--gain", "0")
    quiet = read(tmp_path)
    render(song)
    ratios = [np.abs(a).max() / np.abs(b).max() for a, b in zip(read(tmp_path).values(), quiet.values(), strict=True)]
    assert ratios[0] == pytest.approx(ratios[1], rel=1e-12)


def test_they_begin_at_the_first_bar_if_that_is_kept(song, tmp_path):
    render(song)
    first = next(iter(read(tmp_path).values()))
    render(song, "--keep-start")
    kept = next(iter(read(tmp_path).values()))
    assert not kept[: int(0.5 * 44_100) - 2].any() and first[:1000].any()


def test_a_project_opens_them_with_tempo_and_markers(song, tmp_path):
    render(song, "--keep-start")
    text = (tmp_path / "stems" / "stems.rpp").read_text("utf-8")
    files = re.findall(r'FILE "([^"]+)"', text)
    assert files and all((tmp_path / "stems" / file).exists() for file in files)
    assert text.count("<") == text.count(">") and "TEMPO 120 4 4" in text
    assert re.findall(r"MARKER \d+ (\S+) \"(\w+)\"", text) == [("0", "begin"), ("0.3", "verse")]
    lengths = {float(length) for length in re.findall(r"LENGTH (\S+)", text)}
    assert lengths == {len(next(iter(read(tmp_path).values()))) / 44_100}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--stems", "s"), "--stems: requires --midi; give that too"),
        (("--midi", "song.mid", "--stems", "rods.toml"), "rods.toml is a file; give the name of a folder"),
        (("--keep-start",), "--keep-start: requires --midi"),
        (("--midi", "song.mid", "--stems", "s", "--trace", "t.npz"), "--trace: cannot be combined with --stems"),
    ],
)
def test_what_does_not_fit_is_refused(song, capsys, words, says):
    assert main.main(["render", "rods.toml", *words]) == 2
    assert says in capsys.readouterr().err


def test_the_list_of_stems_is_printed(song, capsys):
    render(song)
    found = json.loads(capsys.readouterr().out)
    assert [path.rpartition(".")[2] for path in found["stems"]] == ["wav", "wav", "rpp"]
