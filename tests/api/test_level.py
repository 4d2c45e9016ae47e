"""The level of a patch: what is heard peaks at half of full scale, and the signals stay in SI units."""

import argparse
import json
import math
import tomllib

import numpy as np
import pytest
import soundfile

import engine
from engine.api.level import measure_keys, measure_level
from engine.api.page import level_of
from engine.cli import main
from engine.cli.live_session import PlayerFactory
from engine.files import SHIPPED_PATCHES, shipped_names
from engine.live.midi import make_allocator
from engine.live.midi_notes import Note

HALF = 20 * math.log10(0.5)  # dBFS
QUICK = "repelled_oscillator", "barrier_linear", "bouncing_ball"
RATE = 44_100


def dbfs(audio):
    """The peak of a sound, dBFS."""
    return 20 * math.log10(np.abs(audio).max())


def played_live(scene, osc=None):
    """The player that `fdh play` makes of a scene."""
    asked = argparse.Namespace(
        tuning=None,
        keyboard_map=None,
        cores=1,
        seconds=None,
        midi=None,
        osc=osc,
        voices=None,
        watch=False,
        block_size=256,
        event_log=None,
    )
    asked.kernel, asked.json, asked.ignore_speed, asked.gain, asked.accuracy = "general", True, True, None, {}
    factory = PlayerFactory(asked, RATE, 2)
    return factory.make_player(factory.prepare(scene), 0.1)


@pytest.fixture
def ball(tmp_path, monkeypatch):
    """Write a shipped patch, with or without a level, as ball.toml here."""
    monkeypatch.chdir(tmp_path)
    text = (SHIPPED_PATCHES / "bouncing_ball.toml").read_text("utf-8")
    lines = [line for line in text.splitlines() if not line.startswith(("level", "#:"))]

    def write(*top):
        (tmp_path / "ball.toml").write_text("\n".join([*top, *lines]), "utf-8")
        return "ball.toml"

    return write


# --- shipped patches


def test_every_shipped_patch_has_a_level():
    names = shipped_names()
    assert len(names) > 40
    for name in names:
        patch = tomllib.loads((SHIPPED_PATCHES / f"{name}.toml").read_text("utf-8"))
        assert isinstance(patch.get("level"), float), name


@pytest.mark.slow_for("piano", "guitar")
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in QUICK else pytest.mark.hard) for n in shipped_names()]
)
def test_the_loudest_note_of_a_shipped_patch_peaks_at_half_of_full_scale(name):
    scene = engine.load(name)
    measured = measure_level(scene, kernel="general")
    assert 20 * math.log10(measured.peak) + scene.level == pytest.approx(HALF, abs=1.0)


@pytest.mark.parametrize("name", QUICK)
def test_a_shipped_patch_is_heard_at_half_of_full_scale_live_and_in_files(name, tmp_path):
    player = played_live(engine.load(name))
    seconds = min(2.0, player.patch.seconds)
    heard = np.zeros((int(seconds * RATE), player.channels), np.float32)
    player.render_into(heard)
    assert dbfs(heard) == pytest.approx(HALF, abs=1.0)
    assert main.main(["render", name, "--level", "patch", "-o", str(tmp_path / "a.wav")]) == 0
    audio, _ = soundfile.read(tmp_path / "a.wav")
    assert dbfs(audio) == pytest.approx(HALF, abs=1.0)


@pytest.mark.hard
@pytest.mark.parametrize("name", ["guitar", "toms", "marimba_keys"])
def test_the_loudest_key_is_heard_at_half_of_full_scale_on_a_keyboard(name):
    scene = engine.load(name)
    peaks = measure_keys(scene, kernel="general")
    player = played_live(scene, osc="0")
    heard = np.zeros((RATE, player.channels), np.float32)
    player.render_into(heard[:1000])  # until the sound has faded in
    make_allocator(player).play(Note(0.0, "on", max(peaks, key=peaks.get), 127))
    player.render_into(heard)
    assert dbfs(heard) == pytest.approx(HALF, abs=1.0)


# --- any patch


def test_a_level_changes_what_is_heard_and_no_signal(ball):
    plain, levelled = engine.load(ball()), engine.load(ball("level = 20.0"))
    signals = [engine.render(scene, seconds=0.3).audio for scene in (plain, levelled)]
    np.testing.assert_array_equal(*signals)
    assert engine.Player(levelled).gain == 10.0 and level_of(levelled, RATE) == 10.0
    peak = np.abs(engine.render(plain, seconds=2.0).audio).max()
    assert engine.Player(plain).gain == pytest.approx(0.5 / peak, rel=1e-6)  # as ever
    assert engine.Player(levelled, gain=3.0).gain == 3.0


@pytest.mark.hard
def test_an_instrument_with_a_level_plays_no_key_before_it_is_heard(monkeypatch):
    """Without one, its middle key is played to find a gain."""
    pressed = []
    monkeypatch.setattr("engine.live.key_allocator.KeyAllocator.play", lambda *note: pressed.append(note))
    scene = engine.load("kalimba_keys")
    assert played_live(scene, osc="0").gain == scene.level_factor
    assert pressed == []
    document = scene.document
    del document["level"]
    played_live(engine.Scene.model_validate(document), osc="0")
    assert len(pressed) == 1


def test_a_file_has_the_level_of_the_patch_if_asked_for(ball, capsys):
    def rendered(*words):
        assert main.main(["render", *words, "--seconds", "0.3", "--subtype", "DOUBLE", "-o", "a.wav"]) == 0
        return soundfile.read("a.wav")[0]

    patch = ball("level = 20.0")
    signal = rendered(patch, "--gain", "0")
    np.testing.assert_array_equal(rendered(patch, "--level", "patch"), signal * 10.0)
    assert "gain +20.0 dB" in capsys.readouterr().out
    assert dbfs(rendered(patch)) == pytest.approx(-1.0)


def test_a_level_that_cannot_be_is_explained(ball, capsys):
    words = {
        ("level = 500.0",): ((), "ball.toml:1 level: 500.0 is out of range; gain of live sound"),
        ('level = "loud"',): ((), 'ball.toml:1 level: "loud" '),
        (): (("--level", "patch"), "--level: ball.toml gives no level; "),
        ("level = 3.0",): (("--level", "loud"), '--level: "loud" is not known; give patch'),
        ("level = 3.0", ""): (("--level", "patch", "--gain", "3"), "--level: cannot be combined with --gain"),
    }
    for top, (options, message) in words.items():
        assert main.main(["render", ball(*top), *options]) == 2
        assert message in capsys.readouterr().err


def test_the_level_is_measured_by_a_command(ball, capsys):
    """What it prints, written into the patch, brings the peak to half of full scale."""
    assert main.main(["level", ball()]) == 0
    _, line = capsys.readouterr().out.split(": ")
    assert main.main(["render", ball(line), "--level", "patch", "-o", "a.wav"]) == 0
    assert dbfs(soundfile.read("a.wav")[0]) == pytest.approx(HALF, abs=0.06)  # the level has one decimal
    capsys.readouterr()
    assert main.main(["level", ball("level = 3.0"), "--json"]) == 0
    (values,) = json.loads(capsys.readouterr().out)["patches"]
    assert values["given"] == 3.0 and values["level"] == pytest.approx(float(line.split(" = ")[1]), abs=0.05)
    assert main.main(["level", "ball.toml", "none.toml"]) == 2
    said = capsys.readouterr()
    assert "ball.toml: level = " in said.out and "as the patch has it" in said.out and "none.toml" in said.err
