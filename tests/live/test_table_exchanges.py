"""A parameter that hardly changes does not click: its new tables leave every sample where it was."""

import math
import random
import zlib
from contextlib import suppress

import numpy as np
import pytest
from conftest import PATCHES

import engine
from engine.instrument.key_names import parse_key
from engine.kernel.data.enums import Quantity
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player

RATE, LEAD, AFTER = 44_100, 8192, 64  # frames before the change, and after it
CHANGE, AUDIBLE = 1e-9, 1e-6  # of the value; of the peak
BEND_SECONDS, BLOCK, HIGH = 0.21, 256, 6000.0  # of two semitones; frames; Hz
LOUDER, INAUDIBLE = 3.0, -100.0  # dB; dB of full scale


def tabled_paths(player: Player) -> list[str]:
    """The live parameters that need new tables."""
    return [name for name, path in player.live_paths.items() if not path.is_glided and not path.is_level]


def assert_no_click(scene: engine.Scene, names: list[str]) -> None:
    """Assert that a change of each of some parameters by 1e-9 changes no sample audibly; each has its own session."""
    for name in names:
        still, turned = Player(scene, RATE, math.inf), Player(scene, RATE, math.inf)
        blocks = [np.zeros((LEAD + AFTER, still.channels), np.float32) for _ in range(2)]
        for player, block in zip((still, turned), blocks, strict=True):
            player.render_into(block[:LEAD])
        with suppress(ValueError):  # it is what it must be, such as the first of some ratios
            turned.set(name, turned.value(name) * (1.0 - CHANGE), seconds=0.0)
        for player, block in zip((still, turned), blocks, strict=True):
            player.render_into(block[LEAD:])
        peak = np.abs(blocks[0]).max()
        difference = np.abs(blocks[0].astype(float) - blocks[1]).max()
        assert difference <= AUDIBLE * max(peak, 1e-30), (name, difference / peak)


def chosen_paths(scene: engine.Scene, count: int) -> list[str]:
    """Some of the parameters that need tables, the same each time."""
    player = Player(scene, RATE, math.inf)
    paths = [name for name in tabled_paths(player) if player.value(name) != 0.0]
    return random.Random(zlib.crc32(scene.title.encode())).sample(paths, min(count, len(paths)))


def hears_accelerations(scene: engine.Scene) -> bool:
    """True if a pickup hears an acceleration or a pressure."""
    player = Player(scene, RATE, math.inf)
    return bool(np.any(player.model.pickups.quantity == Quantity.ACCELERATION))


@pytest.mark.hard
@pytest.mark.parametrize("name", ["marimba", "guitar_body", "violin", "snare", "scraped_stick", "toms"])
def test_new_tables_do_not_click(name: str) -> None:
    scene = engine.load(name)
    assert hears_accelerations(scene)
    assert_no_click(scene, chosen_paths(scene, 2))


@pytest.mark.slow_but_each(2)
@pytest.mark.hard
@pytest.mark.parametrize("path", PATCHES, ids=lambda path: path.stem)
def test_new_tables_click_on_no_patch(path) -> None:
    scene = engine.load(path)
    assert_no_click(scene, chosen_paths(scene, 8))


def level_above(sound: np.ndarray, low: float) -> float:
    """The level of a sound above a frequency, dB of full scale."""
    spectrum = np.fft.rfft(sound * np.hanning(len(sound)))
    spectrum[np.fft.rfftfreq(len(sound), 1 / RATE) < low] = 0.0
    return float(20 * np.log10(np.sqrt(np.mean(np.fft.irfft(spectrum, len(sound)) ** 2)) + 1e-30))


def played_key(name: str, key: str, cents: float, velocity: int = 100, block: int = BLOCK) -> np.ndarray:
    """A key of an instrument at its level, while the wheel moves so far, a little in each block."""
    scene = live_scene(engine.load(name))
    player = Player(scene, RATE, math.inf, scene.level_factor or 1.0, waiting=True)
    keys = KeyAllocator(player)
    keys.play(Note(0.0, "on", parse_key(key), velocity))
    before = np.zeros((RATE // 2, player.channels), np.float32)
    player.render_into(before)
    blocks = []
    count = round(BEND_SECONDS * RATE / BLOCK) * BLOCK // block
    for n in range(count):
        if cents:
            keys.play(Note(0.0, "bend", 0, cents * (n + 1) / count))
            keys.poll()
        blocks.append(np.zeros((block, player.channels), np.float32))
        player.render_into(blocks[-1])
    return np.concatenate(blocks)[:, 0].astype(float)


@pytest.mark.hard
@pytest.mark.parametrize(
    ("name", "key"), [("guitar", "E3"), ("vibraphone", "F4"), ("violin", "A4"), ("marimba_keys", "C4")]
)
def test_a_wheel_that_moves_two_semitones_does_not_buzz(name: str, key: str) -> None:
    """Above 6 kHz it adds less than 3 dB, or what there is lies 100 dB below full scale."""
    still, bent = (level_above(played_key(name, key, cents), HIGH) for cents in (0.0, 200.0))
    assert bent < max(still + LOUDER, INAUDIBLE)


@pytest.mark.hard
def test_what_a_wheel_adds_to_a_sitar_is_not_that_it_moves_in_steps() -> None:
    """A string that rises in pitch grazes its bridge harder: its top grows by 5 dB, however finely the wheel moves.
    Each run is chaotic, so three are averaged."""
    coarse, fine = (
        np.mean([level_above(played_key("sitar", "C4", 200.0, velocity, block), HIGH) for velocity in (68, 76, 100)])
        for block in (4 * BLOCK, BLOCK // 4)
    )
    assert coarse < fine + LOUDER
