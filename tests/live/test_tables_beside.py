"""Live parameters whose tables take long: `set` does not wait for them, and says the range of what it refuses."""

import json
import math
import re
import threading
import time
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.assembly.table_changes import TableChanges
from engine.live.player import Player
from engine.live.replay import replay
from engine.live.shared_memory import Slot
from engine.patch.live_parameters import live_paths, value_at
from engine.patch.live_ranges import live_range

BLOCK = 256
AT_ONCE = 0.25  # s: less than tables take
THICKNESS = "body.top.thickness"
STRING: dict[str, Any] = {
    "name": "string",
    "kind": "string",
    "length": 0.65,
    "linear_density": 4e-4,
    "frequency": 196.0,
}
TOP = {"name": "top", "kind": "soundboard", "size": [0.48, 0.36], "thickness": 2.8e-3, "modes": 20}
TOP |= {"ribs": {"count": 3, "width": 6e-3, "height": 8e-3}}
HAMMER = {"name": "hammer", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 2.0}


def string_on_board() -> engine.Scene:
    """A string that ends on a soundboard, and a hammer."""
    felt = {"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12, "stiffness": 4e9, "exponent": 2.5}
    end = {"name": "bridge", "kind": "end", "body": "string", "at": 1, "on": "top", "on_at": [0.68, 0.45]}
    pickup = {"name": "ear", "body": "top", "at": [0.3, 0.4]}
    document = {"body": [STRING, TOP, HAMMER], "contact": [felt], "connection": [end], "pickup": [pickup]}
    return engine.load(document)


def play(player: Player, blocks: int = 1) -> np.ndarray:
    out = np.zeros((blocks * BLOCK, player.channels), np.float32)
    for begin in range(0, len(out), BLOCK):
        player.render_into(out[begin : begin + BLOCK])
    return out


def set_in_time(player: Player, *arguments: Any, **options: Any) -> None:
    begin = time.perf_counter()
    player.set(*arguments, **options)
    assert time.perf_counter() - begin < AT_ONCE


@pytest.fixture
def slow_tables(monkeypatch):
    """Tables that take at least three tenths of a second, and the values of the thickness that they were made for."""
    made, build = [], TableChanges._build

    def build_slowly(self: TableChanges, scene: engine.Scene) -> Any:
        time.sleep(0.3)
        made.append(scene.body[1].thickness)
        return build(self, scene)

    monkeypatch.setattr(TableChanges, "_build", build_slowly)
    return made


def test_setting_waits_for_no_tables_and_the_samples_are_the_same_each_time(slow_tables):
    """A program that sets and renders in turn: the newest value counts, at the next block; a replay is the same."""
    heard = []
    for _ in range(2):
        slow_tables.clear()
        player = Player(string_on_board(), seconds=math.inf, gain=1e-3)
        heard.append([play(player, 4)])
        for thickness in (2e-3, 4e-3, 5e-3):
            set_in_time(player, THICKNESS, thickness, seconds=0.0)
        assert player.value(THICKNESS) == 5e-3 and not slow_tables
        heard[-1].append(play(player, 4))
        assert slow_tables == [5e-3]  # those in use are known
    assert [np.array_equal(*pair) for pair in zip(*heard, strict=True)] == [True, True]
    events = [event for event in player.log()["events"] if event["why"][0] == "set"]
    assert [(event["why"], event["frame"]) for event in events] == [(["set", THICKNESS, 5e-3], 4 * BLOCK)]
    np.testing.assert_array_equal(replay(json.loads(json.dumps(player.log()))), np.concatenate(heard[-1]))


@pytest.mark.hard
def test_while_one_thread_renders_the_tables_of_another_are_made_beside(slow_tables):
    """The blocks do not wait; what was set while tables were made is merged, and a replay is the same."""
    player = Player(string_on_board(), seconds=math.inf, gain=1e-3)
    heard, is_over = [play(player)], threading.Event()

    def turn() -> None:
        for n in range(60):
            set_in_time(player, THICKNESS, 2e-3 + 1e-5 * n, seconds=0.01)
            time.sleep(0.01)
        while player.value(THICKNESS) != player._parameters._tables.value(player.live_paths[THICKNESS]):
            time.sleep(0.01)
        is_over.set()

    thread = threading.Thread(target=turn)
    thread.start()
    longest = 0.0
    while not is_over.is_set():
        begin = time.perf_counter()
        heard.append(play(player))
        longest = max(longest, time.perf_counter() - begin)
        time.sleep(BLOCK / 44_100)
    thread.join()
    heard.append(play(player, 4))
    assert longest < 0.3
    assert player.value(THICKNESS) == pytest.approx(2.59e-3) and len(slow_tables) < 20
    assert not player.refused and player.meter()["energy_error"] <= 1e-12
    np.testing.assert_array_equal(replay(json.loads(json.dumps(player.log()))), np.concatenate(heard))


def test_a_device_leaves_all_tables_to_a_thread(slow_tables):
    """Once a device plays, nobody has to render for the tables to be made."""
    player = Player(string_on_board(), seconds=math.inf, gain=1e-3)
    player.set(THICKNESS, 3e-3)
    player.leave_to_device()
    player.set("body.top.ribs.width", 7e-3)
    begin = time.monotonic()
    while player._parameters._worker is not None:
        assert time.monotonic() - begin < 20.0
        time.sleep(0.01)
    assert slow_tables[0] == 3e-3 and player._queue.pending() >= 2


def test_what_is_found_late_is_refused_and_said():
    """A board so thick that it has no mode below half of the sample rate sounds on as it was."""
    scene = string_on_board()
    player, plain = (Player(scene, seconds=math.inf, gain=1e-3) for _ in range(2))
    set_in_time(player, THICKNESS, 1.0, seconds=0.0)
    np.testing.assert_array_equal(play(player, 4), play(plain, 4))
    assert player.value(THICKNESS) == 2.8e-3 and "body[1]" in player.refused[THICKNESS]
    assert player.log()["events"][0]["why"] == ["set", THICKNESS, 1.0, f"refused: {player.refused[THICKNESS]}"]
    assert player.meter()["dropped"] == 0
    player.set(THICKNESS, 3e-3, seconds=0.0)
    play(player)
    assert not player.refused and player.value(THICKNESS) == 3e-3


@pytest.mark.parametrize(
    ("parameter", "value", "limits"),
    [
        (THICKNESS, 1e-9, "1e-6 to 1 m"),
        ("body.top.ribs.width", 1e-300, "1e-6 to 1 m"),
        ("body.top.size.1", 0.0, "1e-6 to 1e6 m"),
        ("body.string.length", 1e-9, "1e-6 to 10000 m"),
        ("body.string.frequency", 5e-324, "0.001 to 1e6 Hz"),
        ("body.hammer.mass", 0.0, "1e-12 to 1e9 kg"),
        ("contact.felt.stiffness", 1e-300, r"0, or 1e-6 to 3.16227766e22 N/m\^exponent"),
        ("contact.felt.stiffness", 1e30, r"0, or 1e-6 to 3.16227766e22 N/m\^exponent"),
        ("contact.felt.gap", 1e5, "-10 to 10 m"),
        ("contact.felt.on_at", 1.5, "0 to 1"),
        ("pickup.ear.gain", math.inf, "-1e12 to 1e12"),
    ],
)
def test_a_value_beyond_any_instrument_is_refused_with_the_range(parameter, value, limits):
    player = Player(string_on_board(), seconds=math.inf)
    with pytest.raises(ValueError, match=rf"^{parameter} = \S+ is out of range; {limits}$"):
        set_in_time(player, parameter, value)
    shown = next(one for one in player.scene.parameters() if one.path == parameter)
    assert f"{shown.range} {shown.unit}".strip() == limits.replace("\\", "")


def test_values_that_are_impossible_together_are_refused_as_in_a_patch():
    """A string's frequency needs no more tension than can be given, μ·(2·L·f)²; two decay times let no mode grow."""
    document = string_on_board().model_dump(exclude_unset=True)
    document["body"][0] |= {"t60": [4.0, 1.0], "t60_at": [200.0, 2000.0]}
    player = Player(engine.load(document), seconds=math.inf)
    set_in_time(player, "body.string.length", 3000.0)
    play(player)
    reason = "a string of 3000 m needs a tension of 1.3e+09 N for 300 Hz; at most 1e+09 N are possible"
    with pytest.raises(ValueError, match=rf"^body.string.frequency = 300: {re.escape(reason)}$"):
        player.set("body.string.frequency", 300.0)
    with pytest.raises(ValueError, match=r"^body.string.t60.1 = 5: .*some mode would never decay$"):
        player.set("body.string.t60.1", 5.0)
    document["body"][0] |= {"length": 3000.0, "frequency": 300.0}
    with pytest.raises(engine.PatchError, match=re.escape(f"body[0].frequency: {reason}")):
        engine.load(document)


def test_tables_are_kept_until_the_audio_thread_has_read_them():
    """Also those that it takes a block later than they were due."""
    player = Player(string_on_board(), seconds=math.inf, gain=1e-3)
    play(player)
    tables = player._parameters.tables
    player.set(THICKNESS, 2e-3, seconds=0.0)
    player.make_tables()
    (late,) = tables.exchanges
    player.counters[Slot.FRAME] += BLOCK  # as where a block ends that had begun before
    player.set(THICKNESS, 3e-3, seconds=0.0)
    player.make_tables()
    assert late in tables.exchanges
    play(player)
    player.set(THICKNESS, 4e-3, seconds=0.0)
    player.make_tables()
    assert late not in tables.exchanges and len(tables.exchanges) == 1


@pytest.mark.parametrize("path", sorted((ROOT / "patches").glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_value_is_within_its_live_range(path):
    scene = engine.load(path)
    paths = live_paths(scene, True)
    assert paths
    for name, live in paths.items():
        limits = live_range(scene, live.section, live.number, live.keys)
        assert value_at(scene, live) in limits and -math.inf < limits.low < limits.high < math.inf, name


@pytest.mark.hard
@pytest.mark.parametrize("seed", range(8))
def test_extreme_values_hold_neither_who_sets_them_nor_break_the_balance(seed):
    """A hundred and fifty of them, while a string sounds: each is refused or taken at once, all is finite, and the
    energy that they bring is booked."""
    rng = np.random.default_rng(seed)
    player = Player(string_on_board(), seconds=math.inf, gain=1e-6, kernel="general")
    names = player.live_parameters
    for n in range(150):
        if n % 20 == 0:
            player.strike(velocity=3.0, displacement=-1e-4)
        name, factor = names[int(rng.integers(len(names)))], float(10 ** rng.uniform(-12, 12))
        try:
            set_in_time(player, name, player.value(name) * factor if n % 3 else factor * 1e-290, seconds=0.005)
        except ValueError as error:
            assert "out of range" in str(error) or "body." in str(error)
        assert np.isfinite(play(player)).all()
    assert player.meter()["not_finite"] == 0 and player.meter()["energy_error"] <= 1e-9
