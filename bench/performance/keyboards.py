"""Instruments: how fast a note of each is, and what a piano costs while it is played live with all its strings."""

import math
import time
import tomllib

import numpy as np

import engine
from bench.publish.pieces import PIECES
from bench.publish.report import ROOT, pin, publish
from engine.instrument.expansion import expand_for_score, keys_of
from engine.instrument.key_names import note_name
from engine.instrument.score import Score, make_score
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player
from engine.patch.note_scene import scene_of_note

RATE, BLOCK = 44_100, 128
REPEATS = 5
CHORD = (36, 43, 48, 52, 55, 60, 64, 67, 72, 76)
VELOCITY = 90
STAGES = {  # what is done at the begin of each, and how long it lasts, s
    "at rest, dampers down": ([], 0.5),
    "pedal pressed, ten notes struck at once": ([("sustain", 0, 127), *(("on", key, VELOCITY) for key in CHORD)], 0.1),
    "all 226 strings vibrating after that": ([], 2.0),
    "the same ten notes struck again, one every 50 ms": ([], 0.0),
    **{f"_{key}": ([("on", key, VELOCITY)], 0.05) for key in CHORD},
    "pedal released, ten keys held": ([("sustain", 0, 0)], 1.0),
}


def run() -> None:
    """Measure and publish."""
    on_two_cores = least_costs(cores=2)
    pin()
    one_note()
    live_piano(on_two_cores)


def one_note() -> None:
    """A table of the speed of one note of each instrument: of its lowest key, a middle one, and its highest."""
    rows = []
    for path in sorted((ROOT / "patches").glob("*.toml")):
        document = tomllib.loads(path.read_text("utf-8"))
        if "keyboard" not in document:
            continue
        scene, keys = engine.load(path), keys_of(document["keyboard"])
        chosen = dict.fromkeys((keys[0], keys[len(keys) // 2], keys[-1]))
        factors, errors = [], []
        for key in chosen:
            note = scene_of_note(scene, key, VELOCITY, 3.0, 3.0)
            runs = [engine.render(note, cores=1).stats for _ in range(REPEATS)]
            factors.append(max(stats.real_time_factor for stats in runs))
            errors.append(runs[0].energy.error_max)
        names = ", ".join(note_name(key) for key in chosen)
        rows.append([path.stem, str(len(keys)), names, ", ".join(f"{f:.0f}" for f in factors), f"{max(errors):.0e}"])
    publish("keyboards", ["instrument", "number of keys", "notes", "× real time, each note", "energy error"], rows)


def live_piano(on_two_cores: dict[str, np.ndarray]) -> None:
    """A table of the share of a core that a piano takes in blocks of 128, and of a minute of it.

    on_two_cores: the share of the time of each block of each stage, where strings and case run side by side
    """
    rows = []
    for name, least in least_costs().items():
        shared = on_two_cores[name]
        loads = least.mean(), np.percentile(least, 95), least.max(), shared.mean(), shared.max()
        rows.append([name, *(f"{load:.0%}" for load in loads)])
    scene = engine.load("piano")
    score = minute_of("prelude")
    document = (scene.instrument or {}) | {"seconds": 60.0}
    stats = engine.render(scene.with_expansion(expand_for_score(document, score)), cores=1).stats
    share = f"{1 / stats.real_time_factor:.0%}"
    rows.append([f"one minute rendered (energy error {stats.energy.error_max:.0e})", share, "", "", "", ""])
    loads = ["mean load of one core", "load of 95 % of the blocks, at most", "load of the costliest block"]
    both = ["two cores: mean load", "costliest block"]
    publish("keyboard_live", ["situation", *loads, *both], rows, "keyboards")


def least_costs(cores: int = 1) -> dict[str, np.ndarray]:
    """Of three runs, the least share of the time that each block of each stage takes: what else the machine did is not
    ours. The sound is the same on any number of cores."""
    runs = [play_stages(cores) for _ in range(3)]
    assert all((sound == runs[0][1]).all() for _, sound in runs)
    return {name: np.min([costs[name] for costs, _ in runs], axis=0) for name in runs[0][0]}


def play_stages(cores: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The share of the time that each block of each stage takes, and the last block."""
    player = Player(live_scene(engine.load("piano")), RATE, math.inf, waiting=True, cores=cores)
    keys, out, costs, name = KeyAllocator(player), np.zeros((BLOCK, player.channels), np.float32), {}, ""
    player.render_into(out)
    for stage, (notes, seconds) in STAGES.items():
        name = name if stage.startswith("_") else stage
        for kind, number, value in notes:
            keys.play(Note(0.0, kind, number, value))
        for _ in range(round(seconds * RATE / BLOCK)):
            begin = time.perf_counter()
            player.render_into(out)
            costs.setdefault(name, []).append((time.perf_counter() - begin) * RATE / BLOCK)
    return {name: np.array(values) for name, values in costs.items()}, out


def minute_of(piece: str) -> Score:
    """A piece, again and again for a minute."""
    once = PIECES[piece].score
    starts = np.arange(0.0, 60.0, once.end)
    notes = [note._replace(time=note.time + start) for start in starts for note in once.notes]
    moves = [move._replace(time=move.time + start) for start in starts for move in once.pedals]
    return make_score([n for n in notes if n.time < 58.0], [m for m in moves if m.time < 58.0])
