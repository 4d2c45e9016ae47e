"""The pieces of the gallery: their notation, how they are performed, and their sounds."""

import subprocess
import sys
import tomllib

import numpy as np
import pytest
import soundfile
from conftest import ROOT

from bench.publish import mixed
from bench.publish.notation import perform, read_piece
from bench.publish.performances import replace_line
from bench.publish.pieces import PIECES, TEXTS
from bench.publish.sounds import SOUNDS
from engine.instrument.expansion import keys_of
from engine.live.midi_files import read_notes, read_parts
from engine.patch.control_tables import Midi

WRITTEN = sorted(path.stem for path in TEXTS.glob("*.toml"))
PATCH_OF = {"guitar": "guitar", "violin": "violin", "marimba": "marimba_keys"}  # of the parts of the canon
PLAIN = {"beats": 4, "tempo": [[1, 60]], "dynamics": [[1, 80]]}


def play(notes: str, **others):
    """The notes of one voice at one beat a second: when they begin (s, to a tenth), their keys and durations (s)."""
    voice = {"notes": notes} | others.pop("voice", {})
    score = perform(PLAIN | others | {"voice": [voice]})[""]
    return [(round(note.time, 1), note.key, round(note.duration, 2)) for note in score.notes]


def test_lengths_last_chords_rests_and_ties():
    assert play("C4:1 D4 - E4:1/2 F4") == [(0, 60, 1), (1, 62, 1), (3, 64, 0.5), (3.5, 65, 0.5)]
    assert sorted(play("C4+E4:4")) == [(0, 60, 4), (0, 64, 4)]
    assert play("C4:4~ | C4:2 D4") == [(0, 60, 6), (6, 62, 2)]


def test_tones_of_a_chord_follow_the_bar_and_a_figure_is_repeated():
    played = play("1:2 2", chords="C4 E4 | D4 F4 | E4 G4", voice={"last": 3})
    assert [key for _, key, _ in played] == [60, 64, 62, 65, 64, 67]


def test_a_bar_that_is_not_full_is_refused(tmp_path):
    with pytest.raises(ValueError, match="bar 2 has 3 beats in place of 4"):
        play("C4:1 C4 C4 C4 | C4 C4 C4")
    text = (TEXTS / "romance.toml").read_text("utf-8").replace("B4:1 B4 B4 |", "B4:1 B4 |")
    (tmp_path / "slip.toml").write_text(text, "utf-8")
    with pytest.raises(ValueError, match=r"slip\.toml: bar 1 has 2 beats in place of 3"):
        read_piece(tmp_path / "slip.toml")


def test_a_phrase_is_slower_and_softer_at_its_ends():
    phrased = PLAIN | {"phrases": [4], "swell": 20, "ease": 0.1, "voice": [{"notes": "C4:1 C4 C4 C4", "last": 4}]}
    notes = perform(phrased)[""].notes
    lengths, loud = [note.duration for note in notes], [note.velocity for note in notes]
    assert lengths[0] > 1.05 * lengths[8] and lengths[15] > 1.05 * lengths[7]
    assert np.mean(loud[6:10]) > np.mean(loud[:2]) + 10
    assert np.mean(loud[6:10]) > np.mean(loud[-2:]) + 10


def test_an_accent_is_louder_and_a_voice_has_its_level():
    text = PLAIN | {"voice": [{"notes": "C4:1 C4> C4 C4>"}, {"notes": "C5:1 C5 C5 C5", "level": 30}]}
    notes = perform(text)[""].notes
    low = [note.velocity for note in notes if note.key == 60]
    assert min(low[1], low[3]) > max(low[0], low[2]) - 1
    assert np.mean([note.velocity for note in notes if note.key == 72]) > np.mean(low) + 20


@pytest.mark.parametrize("name", WRITTEN)
def test_a_piece_has_dynamics(name):
    """Loud and soft are far apart, and hardly any velocity is cut off."""
    scores = list(PIECES[name].parts.values())
    assert scores
    for score in scores:
        velocities = np.array([note.velocity for note in score.notes])
        assert np.ptp(velocities) >= 30 and len(set(velocities.tolist())) > 15
        assert velocities.min() >= 20 and np.mean(velocities == 127) < 0.02


@pytest.mark.parametrize("name", ["prelude", "gymnopedie"])
def test_the_pedal_is_changed_with_each_bar(name):
    score = PIECES[name].score

    def is_down(time):
        return [move.value for move in score.pedals if move.name == "sustain" and move.time <= time][-1] > 0.0

    ups = [move.time for move in score.pedals if move.value == 0.0][:-1]
    bars = 19 if name == "prelude" else 22
    assert len(ups) == bars - 1 and is_down(score.end - 0.6)
    for time in ups:
        assert is_down(time - 0.01) and is_down(time + 0.2)
        assert min(abs(note.time - time) for note in score.notes) < 0.02  # with the first note of the bar


def test_the_midi_file_of_three_instruments_is_that_of_the_piece(tmp_path):
    mixed.write_midi(PIECES["canon"].parts, tmp_path / "canon.mid")
    assert (tmp_path / "canon.mid").read_bytes() == mixed.FILE.read_bytes(), "uv run python -m bench pieces canon"
    parts = read_parts(mixed.FILE, Midi()).parts
    assert [(part.name, part.notes) for part in parts] == [
        (name, len(PIECES["canon"].parts[name].notes)) for name in mixed.PROGRAMS
    ]
    assert 30.0 < read_notes(mixed.FILE).end < 60.0


@pytest.mark.parametrize("part", PATCH_OF)
def test_each_part_lies_within_the_compass_of_its_instrument(part):
    document = tomllib.loads((ROOT / "patches" / f"{PATCH_OF[part]}.toml").read_text("utf-8"))
    assert {note.key for note in PIECES["canon"].parts[part].notes} <= set(keys_of(document["keyboard"]))


def test_the_marimba_follows_the_violin_two_bars_later():
    leads, follows = (PIECES["canon"].parts[name].notes for name in ("violin", "marimba"))
    assert [note.key for note in follows[:30]] == [note.key for note in leads[:30]]
    assert 6.5 < follows[0].time - leads[0].time < 8.0  # eight beats


@pytest.mark.hard
def test_three_instruments_render_from_one_file(tmp_path):
    words = [*mixed.COMMAND.split()[1:], "--seconds", "15", "-o", str(tmp_path / "mix.wav")]
    run = subprocess.run([sys.executable, "-m", "engine", *words], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert all(patch in run.stdout for patch in ("guitar", "violin", "marimba_keys"))
    audio, rate = soundfile.read(tmp_path / "mix.wav")
    assert len(audio) == 15 * rate and 0.5 < np.abs(audio).max() < 1.0


@pytest.mark.parametrize("path", sorted([*SOUNDS.glob("*_piece.ogg"), mixed.SOUND]), ids=lambda path: path.stem)
def test_the_sound_of_a_piece_is_half_a_minute_to_a_minute_loud_throughout_and_not_clipped(path):
    audio, rate = soundfile.read(path, dtype="float32", always_2d=True)
    assert 30.0 <= len(audio) / rate <= 60.0
    assert 0.5 < np.abs(audio).max() < 1.0
    power = [np.mean(part**2) for part in np.array_split(audio[: -6 * rate], 8)]
    assert 10 * np.log10(min(power)) > -42.0  # dBFS: no part is silent


def test_the_line_of_a_piece_alone_is_replaced():
    page = "a\nA piece of 5 s: [x_piece.ogg](audio/x_piece.ogg). Old.\nb\n[y_piece.ogg](y)\n"
    assert replace_line(page, "x", "new \\1") == "a\nnew \\1\nb\n[y_piece.ogg](y)\n"
