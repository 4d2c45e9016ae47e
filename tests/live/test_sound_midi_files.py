"""MIDI files as people have them, which are sound: what is read of them is what mido reads. FDH_MIDI_FILES names a
folder of such files; none are in the repository."""

import os
from pathlib import Path

import mido
import pytest

from engine.live.midi_reader import read_song

ENDINGS = (".mid", ".midi", ".kar", ".smf")
WANTED = 64  # files
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif("FDH_MIDI_FILES" not in os.environ, reason="FDH_MIDI_FILES names no folder"),
]


def read_by_mido(path: Path) -> mido.MidiFile | None:
    """The file as mido reads it; None where it is not sound."""
    try:
        return mido.MidiFile(path)
    except Exception:  # whatever it is
        return None


def events_of_mido(file: mido.MidiFile) -> list[list[tuple[int, object]]]:
    """The messages and tempos of each track, with their ticks."""
    found = []
    for track in file.tracks:
        now, events = 0, []
        for message in track:
            now += message.time
            if message.type == "set_tempo":
                events.append((now, message.tempo))
            elif not message.is_meta and hasattr(message, "channel"):
                events.append((now, message.copy(time=0)))
        found.append(events)
    return found


def test_sound_files_are_read_as_mido_reads_them():
    files = sorted(p for p in Path(os.environ["FDH_MIDI_FILES"]).rglob("*") if p.suffix.lower() in ENDINGS)
    compared, different = set(), []
    for path in files:
        data, file = path.read_bytes(), read_by_mido(path)
        if data in compared or file is None or file.type > 1 or data.count(b"MTrk") != len(file.tracks):
            continue  # the header does not count all tracks
        compared.add(data)
        song = read_song(data)
        events = [[(e.ticks, e.message if e.tempo is None else e.tempo) for e in one.events] for one in song.tracks]
        if events != events_of_mido(file) or song.mended or song.ticks_per_beat != file.ticks_per_beat:
            different.append((path.name, dict(song.mended)))
    print(f"{len(compared)} files compared, of {len(files)}")
    assert not different
    assert len(compared) >= WANTED
