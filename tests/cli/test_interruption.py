"""Ctrl-C while a patch, the notes of a MIDI file or a mix is rendered: what there is by then is kept."""

import json
import re
import signal
import subprocess
import sys

import mido
import numpy as np
import pytest
import soundfile
from conftest import ROOT

import engine
from engine.cli import main
from engine.cli.progress import Progress
from engine.live.player import Player

BALL = str(ROOT / "patches" / "bouncing_ball.toml")
PIANO = str(ROOT / "patches" / "piano_c4.toml")
MARIMBA = str(ROOT / "patches" / "marimba.toml")
SECONDS = 0.6
INTERRUPTED = """import signal, sys
from engine.cli.main import program
from engine.cli.progress import Progress

take_note = Progress.__call__

def interrupt(self, share, *more):
    take_note(self, share, *more)
    if share * 3600 > 0.6:
        signal.raise_signal(signal.SIGINT)

Progress.__call__ = interrupt
sys.exit(program())
"""


@pytest.mark.hard
def test_interrupting_keeps_what_is_rendered(tmp_path):
    """Ctrl-C, while it renders: the file holds the samples of the whole, up to there."""
    command = [sys.executable, "-c", INTERRUPTED, BALL, "--seconds", "3600", "-o", "long.wav", "--gain", "0"]
    done = subprocess.run(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, check=False)
    said = done.stderr
    assert done.returncode == 130
    assert re.search(r"^interrupted; wrote the first [\d.e+]+ s of 3600 s$", said, re.MULTILINE)
    assert "Traceback" not in said and [path.name for path in tmp_path.iterdir()] == ["long.wav"]
    audio, _ = soundfile.read(tmp_path / "long.wav", dtype="float32")
    whole = engine.render(engine.load(BALL), seconds=0.5).audio[:, 0].astype(np.float32)
    assert len(audio) > len(whole) and np.array_equal(audio[: len(whole)], whole)


class InterruptAfter:
    """A progress that gets a Ctrl-C once this share is rendered."""

    def __init__(self, share):
        self.share = share

    def __call__(self, share, *_):
        if share >= self.share:
            raise KeyboardInterrupt


@pytest.mark.hard_for("piano_c4-more3", "slack_bass-more3", "piano_c4-more1", "piano_c4-more2", "slack_bass-more2")
@pytest.mark.parametrize(
    "more", [{}, {"oversample": 4}, {"trace_shapes": True}, {"trace_shapes": True, "oversample": 2}]
)
@pytest.mark.parametrize("name", ["piano_c4", "slack_bass"])
def test_what_an_interrupted_rendering_keeps_is_the_first_part_of_the_whole(name, more, monkeypatch):
    monkeypatch.setattr("engine.offline.render.MAX_CHUNK_FRAMES", 500)
    scene = engine.load(name)
    whole = engine.render(scene, 0.1, **more)
    with pytest.raises(KeyboardInterrupt) as stop:
        engine.render(scene, 0.1, progress=InterruptAfter(0.5), **more)
    part = stop.value.rendering
    assert isinstance(part, engine.Rendering) and 0.5 * 0.1 - 4e-3 < part.stats.seconds < 0.1
    assert len(part.audio) == round(part.stats.seconds * 44_100) and part.stats.trusted
    assert np.array_equal(part.audio, whole.audio[: len(part.audio)])
    if "trace_shapes" in more:
        for key, array in part.trace.items():
            if array.ndim and key != "units" and len(array) != len(whole.trace[key]):
                assert np.array_equal(array, whole.trace[key][: len(array)], equal_nan=True)
        assert len(part.trace["time"]) == len(part.audio) * more.get("oversample", 1)


def test_an_interruption_before_anything_is_rendered_keeps_nothing(tmp_path, monkeypatch, capsys):
    with pytest.raises(KeyboardInterrupt) as stop:
        engine.render(engine.load(BALL), 0.1, progress=InterruptAfter(0.0))
    assert not hasattr(stop.value, "rendering")
    monkeypatch.setattr("engine.api.rendering.render_arrays", InterruptAfter(0.0))
    monkeypatch.setattr("engine.api.rendering.checked_integer", lambda *_: InterruptAfter(0.0)(1.0))
    assert main.main([BALL, "-o", str(tmp_path / "a.wav")]) == 130
    assert "interrupted; nothing was written" in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_what_is_left_out_after_an_interruption_is_said(tmp_path, monkeypatch, capsys):
    """While its error is estimated, the rendering is there already; pictures take longer than one waits then."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("engine.analysis.error_estimate.estimate_error", interrupted)
    words = ["--seconds", "0.1", "--error-estimate", "--trace", "a.npz", "--plot", "a.png", "--report", "a.html"]
    assert main.main([BALL, "-o", "a.wav", *words, "--json"]) == 130
    said = capsys.readouterr()
    assert said.err.splitlines()[-1] == "interrupted; wrote all of 0.1 s, without --plot or --report"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "a.wav"]
    result = json.loads(said.out)
    assert result["interrupted"] and result["seconds"] == pytest.approx(0.1)
    assert len(np.load("a.npz")["time"]) == len(soundfile.read("a.wav")[0]) == 4410


# --- notes of MIDI files


@pytest.fixture
def song(tmp_path, monkeypatch):
    """A MIDI file with a note on channels 1 and 2."""
    monkeypatch.chdir(tmp_path)
    file = mido.MidiFile()
    file.tracks.append(mido.MidiTrack(mido.Message("note_on", note=60, channel=channel) for channel in (0, 1)))
    file.tracks[0].append(mido.Message("note_off", note=60, time=480))
    file.save("song.mid")
    return ["--midi", "song.mid", "--seconds", str(SECONDS), "--gain", "0", "--json"]


def interrupt_block(monkeypatch, number, before=False):
    """Send the signal of Ctrl-C in a block of what voices play, at its end or before it. number: from 1, of all"""
    render_into, blocks = Player.render_into, []

    def interrupt(self, out):
        blocks.append(len(out))
        if not before:
            render_into(self, out)
        if len(blocks) == number:
            signal.raise_signal(signal.SIGINT)
        if before:
            render_into(self, out)

    monkeypatch.setattr(Player, "render_into", interrupt)


def test_interrupted_voices_keep_what_is_rendered(song, monkeypatch, capsys):
    assert main.main([PIANO, *song, "-o", "whole.wav"]) == 0
    assert not json.loads(capsys.readouterr().out)["interrupted"]
    interrupt_block(monkeypatch, 4)
    assert main.main([PIANO, *song, "-o", "part.wav"]) == 130
    said = capsys.readouterr()
    assert said.err.splitlines()[-1] == "interrupted; wrote the first 0.3 s of 0.6 s"
    assert json.loads(said.out)["interrupted"] and json.loads(said.out)["seconds"] == pytest.approx(0.3)
    part, whole = soundfile.read("part.wav")[0], soundfile.read("whole.wav")[0]
    kept = 13_230 - 221  # the end fades out
    assert len(part) == 13_230 and np.any(part) and np.array_equal(part[:kept], whole[:kept])


def test_voices_that_are_interrupted_at_once_write_nothing(song, monkeypatch, capsys, tmp_path):
    interrupt_block(monkeypatch, 1)
    assert main.main([PIANO, *song, "-o", "part.wav"]) == 130
    assert "interrupted; nothing was written" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["song.mid"]


@pytest.mark.hard_for(
    "7-interrupted; wrote all of 0.6 s of piano_c4, without marimba",
    "10-interrupted; wrote the first 0.3 s of 0.6 s of marimba",
)
@pytest.mark.parametrize(
    ("block", "says"),
    [
        (4, "interrupted; wrote the first 0.3 s of 0.6 s of piano_c4, without marimba"),
        (7, "interrupted; wrote all of 0.6 s of piano_c4, without marimba"),
        (10, "interrupted; wrote the first 0.3 s of 0.6 s of marimba"),
    ],
)
def test_an_interrupted_mix_keeps_what_is_rendered(song, monkeypatch, capsys, block, says):
    words = [PIANO, *song, "--play", f"2={MARIMBA}"]
    assert main.main([*words, "-o", "whole.wav"]) == 0
    assert not json.loads(capsys.readouterr().out)["interrupted"]
    assert main.main([PIANO, *song, "--channels", "1", "-o", "first.wav"]) == 0
    capsys.readouterr()
    interrupt_block(monkeypatch, block)
    assert main.main([*words, "-o", "part.wav"]) == 130
    said = capsys.readouterr()
    assert said.err.splitlines()[-1] == says
    result, part = json.loads(said.out), soundfile.read("part.wav")[0]
    assert result["interrupted"] and len(result["parts"]) == (2 if block == 10 else 1)
    expected = soundfile.read("whole.wav" if block == 10 else "first.wav")[0]
    assert np.any(part) and len(part) == (13_230 if block == 4 else 26_460)
    if expected.ndim == 1:
        expected = np.stack([expected, expected], axis=1)
    kept = (13_230 if block != 7 else 26_460) - 221  # the end fades out
    np.testing.assert_allclose(part[:kept].reshape(kept, -1)[:, 0], expected[:kept, 0], rtol=1e-6, atol=1e-12)


@pytest.mark.hard
def test_an_interrupted_instrument_keeps_what_is_rendered_in_a_mix(song, monkeypatch, capsys):
    """Its keys are rendered as those of a score are."""
    monkeypatch.setattr("engine.offline.render.MAX_CHUNK_FRAMES", 1000)
    take_note = Progress.__call__

    def interrupt(self, share, *more):
        take_note(self, share, *more)
        if self.task == "rendering kalimba_keys" and share > 0.5:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Progress, "__call__", interrupt)
    assert main.main([PIANO, *song, "--play", "2=kalimba_keys", "-o", "part.wav"]) == 130
    said = capsys.readouterr()
    assert re.fullmatch(r"interrupted; wrote the first 0\.3\d* s of 0\.6 s of kalimba_keys", said.err.splitlines()[-1])
    assert json.loads(said.out)["interrupted"] and len(soundfile.read("part.wav")[0]) == 26_460
