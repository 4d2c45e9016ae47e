"""What a player is asked for that cannot be, and logs that are none: an error that says what would be right."""

import json
import math
import os

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.cli import main
from engine.live.audio_memory import MAX_FRAMES
from engine.live.player import Player
from engine.live.shared_memory import Slot

PIANO = engine.load(ROOT / "patches" / "piano_c4.toml")
FELT = "contact.felt_0.stiffness"
HUGE = 10**30
BAD = [
    (
        lambda p: p.strike("hammer_0", frame=HUGE),
        ValueError,
        f"frame is out of range; give 0, which means at once, to {MAX_FRAMES}",
    ),
    (lambda p: p.strike("hammer_0", frame=-1), ValueError, "frame is out of range"),
    (lambda p: p.strike("hammer_0", frame=1.5), TypeError, "frame = 1.5 is not a whole number; give one, such as 0"),
    (lambda p: p.strike("hammer_0", math.nan), ValueError, "velocity = nan is out of range"),
    (lambda p: p.strike("hammer_0", 10**400), ValueError, "velocity = "),
    (lambda p: p.strike("hammer_0", "fast"), ValueError, "velocity = 'fast' is out of range"),
    (lambda p: p.set(FELT, "x"), TypeError, f"{FELT} = 'x' is not a number; give one, such as 1.0"),
    (lambda p: p.set(FELT, None), TypeError, "is not a number"),
    (lambda p: p.set(FELT), TypeError, "is not a number"),
    (lambda p: p.set({FELT: 1e9}, 0.5), ValueError, "value = 0.5 belongs to no path; leave it out"),
    (lambda p: p.set({}, 0.0), ValueError, "value = 0.0 belongs to no path"),
    (lambda p: p.set(FELT, math.nan), ValueError, f"{FELT} = nan is out of range"),
    (lambda p: p.set(FELT, 10**400), ValueError, "it has more digits than a number holds"),
    (lambda p: p.set(FELT, 1e9, frame=HUGE), ValueError, "frame is out of range"),
    (lambda p: p.set(FELT, 1e9, seconds=math.inf), ValueError, "seconds = inf is out of range"),
    (lambda p: p.damp(sigma=math.nan), ValueError, "sigma = nan is out of range"),
    (lambda p: p.damp(sigma=-1.0), ValueError, "sigma = -1 is out of range"),
    (lambda p: p.damp(seconds=math.nan), ValueError, "seconds = nan is out of range"),
    (lambda p: p.damp(frame=HUGE), ValueError, "frame is out of range"),
    (lambda p: p.lift("string_0", frame=HUGE), ValueError, "frame is out of range"),
    (lambda p: p.tune(0, math.nan), ValueError, "ratio = nan is out of range; give at least 0.5"),
    (lambda p: p.tune(0, math.inf), ValueError, "ratio = inf is out of range"),
    (lambda p: p.tune(0, "high"), TypeError, "ratio = 'high' is not a number"),
    (lambda p: p.tune(0, 1.0, frame=HUGE), ValueError, "frame is out of range"),
    (lambda p: p.tune(0, 1.0, seconds=math.nan), ValueError, "seconds = nan is out of range; give 0 to 3600"),
    (lambda p: p.tune(0.5, 1.0), TypeError, "voice = 0.5 is not a whole number"),
    (lambda p: p.tune(7, 1.0), IndexError, "there is no voice 7; the player has 1"),
    (lambda p: p.pluck("string_0", math.nan), ValueError, "scale = nan is out of range"),
    (lambda p: p.pluck("string_0", "x"), TypeError, "scale = 'x' is not a number"),
]


@pytest.fixture(scope="module")
def player():
    return Player(PIANO, gain=0.1, seconds=math.inf, voices=1, lowest=0.5)


@pytest.mark.parametrize(("what", "kind", "says"), BAD, ids=range(len(BAD)))
def test_what_cannot_be_is_refused_and_nothing_changes(player, what, kind, says):
    before = int(player.counters[Slot.WRITE_INDEX]), len(player.log()["events"]), player._queue.pending()
    with pytest.raises(kind) as found:
        what(player)
    assert says in str(found.value) and "\n" not in str(found.value)
    assert (int(player.counters[Slot.WRITE_INDEX]), len(player.log()["events"]), player._queue.pending()) == before


def test_numbers_of_numpy_are_numbers(player):
    player.strike("hammer_0", np.float32(2.0), frame=np.int64(10))
    player.set(FELT, np.float64(1e9), frame=np.uint16(10))
    player.tune(np.int32(0), np.float64(1.1))
    out = np.zeros((2000, player.channels), np.float32)
    player.render_into(out)
    assert out.any()
    assert json.dumps(player.log())


@pytest.fixture(scope="module")
def log():
    one = Player(PIANO, gain=0.1)
    one.strike("hammer", 2.0)
    one.render_into(np.zeros((500, one.channels), np.float32))
    return one.log()


def edited(log, **change):
    return json.dumps(log | change)


LOGS = {
    "infinity": (lambda log: edited(log, gain=math.inf), "Infinity is not a valid JSON number"),
    "not a number": (lambda log: edited(log, lowest=math.nan), "NaN is not a valid JSON number"),
    "1e999": (lambda log: edited(log).replace('"gain": 0.1', '"gain": 1e999'), "gain: "),
    "70 bits": (lambda log: edited(log, frames=1 << 70), "frames: "),
    "70 bits of a row": (
        lambda log: edited(log, events=[{"frame": 1, "why": [], "row": [0, 0, 0, 1, 0, 1 << 70, 0, 0]}]),
        "an impossible event",
    ),
    "1e30 in a row": (
        lambda log: edited(log, events=[{"frame": 1, "why": [], "row": [0, 0, 0, 1, 0, 1e30, 0, 0]}]),
        "an impossible event",
    ),
    "5000 digits": (lambda log: edited(log).replace('"gain": 0.1', '"gain": ' + "9" * 5000), "cannot be read as a log"),
    "deep": (lambda log: "[" * 100_000 + "]" * 100_000, "its brackets are nested too deeply"),
    "deep in a why": (
        lambda log: edited(log, events=[{"frame": 1, "why": ["X"], "row": []}]).replace('"X"', "[" * 5000 + "]" * 5000),
        "cannot be read as a log",
    ),
    "a tune of nothing": (
        lambda log: edited(log, events=[{"frame": 1, "why": ["tune", {}, []], "row": [0] * 8}]),
        "it describes an impossible state",
    ),
    "days": (lambda log: edited(log, frames=1 << 33, end=1 << 40), "frames; at most 10 hours"),
    "empty": (lambda log: "", "cannot be read as a log"),
    "a list": (lambda log: "[]", "cannot be read as a log"),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_that_is_none_is_refused_in_a_line(log, tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    made, says = LOGS[name]
    (tmp_path / "log.json").write_text(made(log), "utf-8")
    assert main.main(["replay", "log.json", "-o", "a.wav"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("log.json: cannot be read as a log (") and says in said and said.count("\n") == 1
    assert not (tmp_path / "a.wav").exists()


def test_logs_that_are_no_files_are_refused(log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    assert main.main(["replay", "pipe", "-o", "a.wav"]) == 2
    assert "is not a file, but a pipe" in capsys.readouterr().err


def test_a_replay_refuses_a_format_that_cannot_hold_it(log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.json").write_text(edited(log, samplerate=384_000), "utf-8")
    assert main.main(["replay", "log.json", "-o", "a.ogg"]) == 2
    assert "--output: OGG files hold 200000 Hz at most" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("following", "kind", "says"),
    [
        (lambda p: p, ValueError, "this player plays already; give another one"),
        (lambda p: 5, TypeError, "5 is not a player; give one, such as"),
        (lambda p: engine.Player(PIANO, gain=0.1, samplerate=48_000), ValueError, "it has 2 channels at 48000 Hz"),
    ],
)
def test_what_cannot_take_over_is_refused_and_the_sound_goes_on(following, kind, says):
    player = engine.Player(PIANO, gain=0.1)
    with pytest.raises(kind) as refused:
        player.cross_fade_to(following(player))
    assert says in str(refused.value)
    assert player.read(2000).any()


def test_only_an_array_that_may_be_written_is_filled():
    player = engine.Player(PIANO, gain=0.1)
    fixed = np.zeros((100, player.channels), np.float32)
    fixed.flags.writeable = False
    for out, kind in ((fixed, ValueError), (np.zeros((100, player.channels)), ValueError), ([[0.0]], TypeError)):
        with pytest.raises(kind, match="out must be"):
            player.render_into(out)
    assert player.frame == 0 and not fixed.any()


def test_a_player_that_was_taken_over_stops_with_the_other():
    first, second = (engine.Player(PIANO, gain=0.1, seconds=math.inf) for _ in range(2))
    first.read(1000)
    first.cross_fade_to(second)
    first.read(2000)
    second.strike("hammer")
    assert first.read(2000).any() and not first.finished
    first.stop()
    assert not first.read(20_000)[-1000:].any() and first.finished


def test_a_parameter_that_is_not_there_is_said_with_those_that_are():
    with pytest.raises(KeyError, match=r"no live parameter .*stifness; the live parameters are .*stiffness"):
        engine.Player(PIANO, gain=0.1).value("contact.felt.stifness")
