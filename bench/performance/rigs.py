"""Load of a rig of four instruments in blocks of 256 frames on two cores, and of each of its parts alone. All play a
note each eighth of a second, and hold it for half a second."""

import math
import tempfile
import time
from pathlib import Path

import numpy as np

import engine
from bench.publish.report import publish
from engine.instrument.expansion import keys_of
from engine.instrument.held_keys import ALL
from engine.live.key_allocator import live_scene
from engine.live.midi_notes import Note
from engine.live.mpe import NoteChannels
from engine.live.player import Player
from engine.live.rig_keys import RigKeys

RATE, BLOCK, SECONDS = 44_100, 256, 12.0
PARTS = ("guitar", "marimba_keys", "vibraphone", "kalimba_keys")
EVERY, HELD = 0.125, 0.5  # s
REPEATS = 3


def rig_of(folder: Path, parts: tuple[str, ...], head: str = "") -> engine.Scene:
    """A rig of shipped instruments, each on a channel of its own. head: other tables"""
    tables = [head] + [f'[[part]]\npatch = "{name}"\nchannel = {n}\n' for n, name in enumerate(parts, 1)]
    path = folder / "rig.toml"
    path.write_text("\n".join(tables), "utf-8")
    return engine.load(path)


def notes_of(scene: engine.Scene) -> list[tuple[int, Note]]:
    """What is played, with the block that it comes before."""
    assert scene.rig is not None
    told = list[tuple[float, Note]]()
    for channel, member in enumerate(scene.rig.members, 1):
        keys = keys_of((member.scene.instrument or {})["keyboard"])
        for n in range(round(SECONDS / EVERY)):
            key, begin = keys[(7 * n + 3) % len(keys)], n * EVERY
            told += [(begin, Note(0.0, "on", key, 90, NoteChannels(channel, ALL), channel))]
            told += [(begin + HELD, Note(0.0, "off", key, 64, NoteChannels(channel, ALL), channel))]
    told.sort(key=lambda one: one[0])
    return [(int(seconds * RATE / BLOCK), note) for seconds, note in told]


def loads(scene: engine.Scene, cores: int) -> np.ndarray:
    """Share of its deadline that each block takes; of each, the least of some runs."""
    notes, least = notes_of(scene), np.inf
    for _ in range(REPEATS):
        player = Player(live_scene(scene), RATE, math.inf, 1.0, waiting=True, cores=cores)
        assert scene.rig is not None
        keys = RigKeys(player, scene.rig)
        out, waiting, taken = np.zeros((BLOCK, player.channels), np.float32), list(notes), list[float]()
        for block in range(round(SECONDS * RATE / BLOCK)):
            while waiting and waiting[0][0] <= block:
                keys.play(waiting.pop(0)[1])
            begin = time.perf_counter()
            player.render_into(out)
            taken.append((time.perf_counter() - begin) * RATE / BLOCK)
        least = np.minimum(least, taken)
    return np.asarray(least)


def run() -> None:
    """Measure and publish."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        alone = [((name,), "") for name in PARTS]
        for parts, head in (*alone, (PARTS, ""), (PARTS, "[accuracy]\nsubsteps = 1\n")):
            scene = rig_of(Path(folder), parts, head)
            load = loads(scene, 2)
            mean, late, worst = load.mean(), np.quantile(load, 0.99), load.max()
            name = parts[0] if len(parts) == 1 else f"all four, substeps = {scene.accuracy.substeps}"
            rows.append([name, *(f"{100 * share:.0f} %" for share in (mean, late, worst))])
    publish("rigs", ["rig", "load, mean", "99 % of the blocks", "the dearest block"], rows)
