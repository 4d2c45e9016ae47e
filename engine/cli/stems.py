"""Stems: a sound file for each part of a mix, which together are the mix, and a REAPER project that opens them."""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from engine.cli.messages import CommandError, write_file
from engine.faults import Fault
from engine.output_files import absolute_path, is_writable_folder, write_text

if TYPE_CHECKING:
    import numpy as np

    from engine.live.midi_parts import Excerpt
    from engine.sound.about import Marker
    from engine.sound.sound_file import PreparedSound

USUAL_TEMPO = 120.0  # quarter notes per minute, of a file that gives none
OTHER_CHARACTERS = re.compile(r"[^\w-]+")
PROJECT = "stems.rpp"


def check_stems(folder: str | None, has_midi: bool) -> list[Fault]:
    """List the faults of --stems."""
    if folder is None:
        return []
    if not has_midi:
        return [Fault("--stems", "requires --midi; give that too")]
    place = Path(folder)
    parent = place if place.is_dir() else absolute_path(place).parent
    if place.exists() and not place.is_dir():
        return [Fault("--stems", f"{folder} is a file; give the name of a folder")]
    if not parent.is_dir() or not is_writable_folder(parent):
        return [Fault("--stems", f"{parent} is no folder that can be written to; write elsewhere")]
    return []


def read_markers(path: Path, excerpt: "Excerpt", seconds: float) -> "tuple[float, tuple[Marker, ...]]":
    """Return the tempo of a MIDI file where a sound begins, in quarter notes per minute, and the markers within it.

    excerpt: what the sound has of the file; seconds: its length
    """
    import mido

    from engine.live.midi_files import read_parts
    from engine.sound.about import Marker

    lengthening, begin = read_parts(path, tempo=excerpt.tempo).lengthening, excerpt.begin or 0.0
    now, tempo, markers = 0.0, USUAL_TEMPO, list[Marker]()
    try:
        for message in mido.MidiFile(path, clip=True):
            now += lengthening * message.time
            if message.type == "set_tempo" and now <= begin + 1e-9:
                tempo = mido.tempo2bpm(message.tempo)
            elif message.type == "marker" and begin <= now <= begin + seconds:
                markers.append(Marker(now - begin, message.text))
    except (OSError, ValueError, EOFError, TypeError):  # a broken file, of which the notes were read all the same
        pass
    return tempo / lengthening, tuple(markers)


def write_stems(folder: Path, names: Sequence[str], sounds: "Sequence[np.ndarray]", mix: "PreparedSound") -> list[Path]:
    """Write the sounds of a mix [frames, channels], with its cut and its gain, and a project that opens them. Returns
    the paths. Raises CommandError."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise CommandError(f"cannot make {folder} ({error.strerror})") from error
    paths = list[Path]()
    for n, (name, audio) in enumerate(zip(names, sounds, strict=True), 1):
        path = folder / f"{n:02d}_{OTHER_CHARACTERS.sub('_', name)}{mix.file.path.suffix}"
        about = None if mix.file.about is None else replace(mix.file.about, title=name)
        part = mix.prepare_part(path, audio, about)
        write_file(path, partial(_write, part))
        paths.append(path)
    project = describe_project(names, paths, mix)
    write_file(folder / PROJECT, lambda path: write_text(path, project))
    return [*paths, folder / PROJECT]


def _write(sound: "PreparedSound", _: Path) -> None:
    sound.write()


def describe_project(names: Sequence[str], paths: Sequence[Path], mix: "PreparedSound") -> str:
    """Return a project of REAPER: a track for each sound, all from the begin, with tempo and markers."""
    about, seconds = mix.file.about, len(mix.audio) / mix.samplerate
    tempo = USUAL_TEMPO if about is None or about.tempo is None else about.tempo
    lines = ['<REAPER_PROJECT 0.1 "6.0" 0', f"  SAMPLERATE {mix.samplerate} 1 0", f"  TEMPO {tempo:.9g} 4 4"]
    for n, marker in enumerate(() if about is None else about.markers, 1):
        lines.append(f"  MARKER {n} {marker.seconds:.9g} {_quoted(marker.name)} 0")
    for name, path in zip(names, paths, strict=True):
        lines += [f"  <TRACK\n    NAME {_quoted(name)}", "    VOLPAN 1 0 -1 -1 1"]
        lines += [f"    <ITEM\n      POSITION 0\n      LENGTH {seconds:.12g}\n      NAME {_quoted(name)}"]
        lines += [f"      <SOURCE WAVE\n        FILE {_quoted(path.name)}\n      >\n    >\n  >"]
    return "\n".join([*lines, ">\n"])


def _quoted(text: str) -> str:
    """A text in quotes, as a project has it: it knows no mark for a quote within."""
    return '"' + text.replace('"', "'").replace("\n", " ") + '"'
