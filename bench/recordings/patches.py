"""Patches of single notes beside recorded notes of a grand."""

import math
from functools import cache

import engine
from bench.publish.report import ROOT, publish
from bench.recordings.decay import SECONDS, median_decays
from bench.recordings.instrument import VELOCITY, ReadNote
from bench.recordings.keys import key_frequency, key_number
from bench.recordings.measure import band_levels, clear_cells, difference, knock_level
from bench.recordings.note import Sound
from bench.recordings.partials import read_partials

VELOCITIES = (4, 10, 16)
SPEED_PER_VELOCITY = 1.12  # the hammer's speed, and the force of the knock, from one velocity to the next
RATE = 44_100

KEYS = {note: key_number(note) for note in ("C2", "C4", "C7")}
NEIGHBOURS = {"C2": "D#2", "C4": "D#4", "C7": "D#7"}
PATCHES = {"piano_choir": "C4"} | {f"{make}_{note.lower()}": note for make in ("piano", "grand") for note in KEYS}

HEADER = [
    "sound",
    "compared with the recording",
    "level difference, RMS, dB",
    "level difference, mean absolute, dB",
    "early decay, dB/s",
    "late decay, dB/s",
    "knock, dB",
]


def strike_once(scene: engine.Scene, velocity: int = VELOCITY) -> engine.Scene:
    """A patch whose score is gone, so that only its first blow sounds; at another velocity, hammers and knock are
    faster or slower by one factor."""
    factor = SPEED_PER_VELOCITY ** (velocity - VELOCITY)
    table = scene.model_dump(exclude_none=True) | {"event": []}
    for body in table["body"]:
        if body["kind"] == "mass":
            body["velocity"] *= factor
    for force in table["force"]:
        force["amplitude"] *= factor
    return engine.Scene.model_validate(table)


def row(name: str, against: str, sound: Sound, recorded: Sound, key: int) -> list[str]:
    """What is measured of a sound, and of how far it is from a recording."""
    rms, mean = difference(band_levels(*sound), band_levels(*recorded), clear_cells(*recorded))
    partials = read_partials(*sound, key_frequency(key))
    early, late = median_decays(*sound, partials) if partials else (math.nan, math.nan)
    knock = knock_level(*sound, key_frequency(key))
    return [name, against, f"{rms:.1f}", f"{mean:.1f}", f"{early:.0f}", f"{late:.1f}", f"{knock:.0f}"]


def run(read: ReadNote) -> None:
    """Measure, print and write the table."""
    read = cache(read)
    rows = []
    for note, key in KEYS.items():
        recorded = read(key, VELOCITY)
        assert recorded is not None  # the command has looked
        for other, velocity in [(note, v) for v in VELOCITIES] + [(NEIGHBOURS[note], VELOCITY)]:
            if sound := read(key_number(other), velocity):
                found = row(f"recording, {other}, velocity {velocity}", "", sound, recorded, key)
                if other != note:  # its partials are others
                    found[4:] = ["", "", ""]
                rows.append([found[0], f"{note}, velocity {VELOCITY}", *found[2:]])
        for name in (
            name for name, its in PATCHES.items() if its == note and (ROOT / "patches" / f"{name}.toml").exists()
        ):
            scene = engine.load(ROOT / "patches" / f"{name}.toml")
            for velocity in VELOCITIES:
                if recorded := read(key, velocity):
                    rendering = engine.render(strike_once(scene, velocity), SECONDS, RATE)
                    rows.append(row(name, f"{note}, velocity {velocity}", (rendering.audio, RATE), recorded, key))
    publish("recordings", HEADER, rows)
