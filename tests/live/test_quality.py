"""Quality that sinks and rises with the load: what it drops fades out and is gone, and it rises where it would fit."""

import json
import math

import numpy as np
import pytest

import engine
from engine.assembly.event_table import EventRow
from engine.instrument.key_names import parse_key
from engine.kernel.data.enums import EventKind, Sleep
from engine.live.kernels import RECORD_LOAD, kernel_of_memory
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player
from engine.live.replay import replay
from engine.live.shared_memory import Slot

RATE, BLOCK = 44_100, 256
FADE = 0.02  # s
KEYS = ["C4", "E4", "G4", "B4", "D5"]


def chord_player(name: str, **options) -> Player:
    """An instrument that plays a chord, each note softer than the one before."""
    player = Player(live_scene(engine.load(name)), RATE, math.inf, 1e-3, waiting=True, **options)
    keys = KeyAllocator(player)
    for n, key in enumerate(KEYS):
        keys.play(Note(0.0, "on", parse_key(key), 110 - 20 * n))
    return player


def played(player: Player, seconds: float, block: int = BLOCK) -> np.ndarray:
    """Play on, in blocks."""
    out = np.zeros((round(seconds * RATE), player.channels), np.float32)
    for begin in range(0, len(out), block):
        player.render_into(out[begin : begin + block])
    return out.astype(float)


def set_quality(player: Player, level: int) -> None:
    """Let the audio thread play at a level of quality."""
    with_level = EventRow(EventKind.QUALITY, 0, level, 0, 0, 0)
    player._queue.put(["quality", level], with_level)


@pytest.mark.hard
@pytest.mark.parametrize("name", ["vibraphone", "marimba_keys"])
def test_what_is_dropped_fades_out_without_a_step_and_does_not_come_back(name: str) -> None:
    """The largest step from sample to sample is that of the full sound; and after the fade, the sound is that of the
    notes that are left, also when the quality has risen again."""
    full, reduced = chord_player(name), chord_player(name)
    islands = len(reduced.state.sleep)
    before = [played(player, 0.5) for player in (full, reduced)]
    np.testing.assert_array_equal(*before)
    asleep = np.sum(reduced.state.sleep[:, Sleep.WAKE_FRAME] > reduced.frame)
    set_quality(reduced, 2)
    dropping = played(reduced, 0.5)
    truth = played(full, 0.5)
    assert np.abs(np.diff(dropping, axis=0)).max() <= np.abs(np.diff(truth, axis=0)).max() * 1.02
    set_quality(reduced, 0)
    after = played(reduced, 0.5)
    silent = np.sum(reduced.state.sleep[:, Sleep.WAKE_FRAME] > reduced.frame)
    assert silent >= asleep + 2 and islands > silent
    assert np.sqrt(np.mean(after**2)) <= np.sqrt(np.mean(played(full, 0.5) ** 2)) * 1.01
    assert reduced.meter()["energy_error"] <= 1e-12


@pytest.mark.hard
@pytest.mark.parametrize("block", [64, 1000])
def test_a_replay_drops_the_same(block: int) -> None:
    player = chord_player("vibraphone", cores=2)
    parts = [played(player, 0.2, block)]
    for level in (1, 3, 0, 1):
        set_quality(player, level)
        parts.append(played(player, 0.05, block))
    KeyAllocator(player).play(Note(0.0, "on", parse_key("D5"), 90))
    parts.append(played(player, 0.2, block))
    again = replay(json.loads(json.dumps(player.log())))
    np.testing.assert_array_equal(again, np.concatenate(parts).astype(np.float32))


@pytest.mark.hard
def test_a_note_that_begins_while_its_bar_fades_out_sounds() -> None:
    full, reduced = chord_player("vibraphone"), chord_player("vibraphone")
    for player in (full, reduced):
        played(player, 0.5)
    set_quality(reduced, len(KEYS) - 1)
    for player in (full, reduced):
        played(player, 0.01)
        KeyAllocator(player).play(Note(0.0, "on", parse_key(KEYS[-1]), 127))
    levels = [np.sqrt(np.mean(played(player, 0.3)[RATE // 10 :] ** 2)) for player in (full, reduced)]
    assert levels[1] > 0.3 * levels[0]


# --- the load


class Load:
    """Loads of the blocks of a player, by which its quality adapts.

    scene: refined, so that coarser models come before islands fade out
    """

    def __init__(self, full: float, reduced: float) -> None:
        string = {"name": "a", "kind": "string", "length": 0.6, "mass": 4e-3, "frequency": 220.0}
        hammer = {"name": "h", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 1.0}
        contact = {"body": "h", "on": "a", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5}
        told = {"body": [string, hammer], "contact": [contact], "pickup": [{"body": "a", "at": 0.9}]}
        scene = engine.Scene.model_validate(told | {"accuracy": {"order": 4}})
        self.player, self.loads = Player(scene, RATE, math.inf), (full, reduced)

    def play(self, seconds: float, spike: float = 0.0) -> list[int]:
        """Play blocks; return the levels of quality. spike: the load of all of them, in place of what they cost"""
        levels, counters = [], self.player.counters
        for _ in range(round(seconds * RATE / BLOCK)):
            share = spike or self.loads[min(1, int(counters[Slot.QUALITY]))]
            counters[Slot.FRAME] += BLOCK
            kernel_of_memory(RECORD_LOAD)(self.player.memory.address, BLOCK, share * BLOCK / RATE)
            levels.append(int(counters[Slot.QUALITY]))
        return levels


@pytest.mark.parametrize("loads", [(0.5, 0.35), (0.6, 0.45), (0.75, 0.5), (0.45, 0.42), (0.7, 0.7)])
def test_quality_rises_again_where_it_would_fit(loads: tuple[float, float]) -> None:
    load = Load(*loads)
    assert set(load.play(2.0)) == {0}
    assert load.play(BLOCK / RATE, spike=1.5) == [1]
    assert load.play(2.0)[-1] == 0


@pytest.mark.parametrize("loads", [(0.95, 0.45), (2.5, 0.3), (0.85, 0.75)])
def test_quality_stays_low_where_a_higher_one_would_not_fit(loads: tuple[float, float]) -> None:
    """It is tried again now and then, as the sound may have changed."""
    load = Load(*loads)
    levels = load.play(60.0)
    assert levels[0] == 1
    assert levels.count(0) < 0.03 * len(levels)
