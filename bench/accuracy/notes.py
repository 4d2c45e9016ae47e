"""Does each note of a MIDI file sound as it does alone? Run `uv run python -m bench notes FOLDER`.

Instruments play the first seconds of the MIDI files of a folder. Each event that a note alone would cause must be in
the scene of the file, with the same numbers and at the same time. The rules take away what a note would change after
its end, dampers that a pedal or the key itself keeps up, and what comes after the excerpt. What no note causes is
listed, too, dampers and pitch bends apart. A player must give the samples of the rendering, bit for bit, and drop no
event.

The level of a note is the RMS velocity of that body of its key which moves most, masses apart, over 100 ms or until the
note ends. Where it differs from that of the note alone by more than 1 dB, a body that still vibrates may be why: the
second level is that of the body just before the note, relative to the note alone. Where none does, the last number is
by how much the level of the note alone changes with its velocity, one up or down. A bowed string begins differently
after the smallest disturbance, so that this is 2 dB or more.
"""

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

import engine
from bench.accuracy.lone_notes import EventCount, LoneNote, NoteRules, events_alone, without_time
from bench.accuracy.note_levels import ALLOWED, RATE, SOUNDING, NoteLevels
from engine.instrument.expansion import keys_of
from engine.instrument.key_names import note_name
from engine.instrument.key_sequencer import FULL_VELOCITY
from engine.instrument.key_writer import KeyWriter
from engine.live.audio_memory import MAX_FRAMES
from engine.live.instrument_notes import PlayedFile, scene_of_file
from engine.live.midi_notes import MidiError
from engine.live.midi_parts import Excerpt
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.patch.scene import Scene

BLOCK = 256
GAIN = 2.0**-24  # of a player: far from its limiter, and no rounding
PATCHES = "vibraphone,violin,guitar,piano"


@dataclass
class Counts:
    """What was counted at the files of a patch."""

    files: int = 0
    notes: int = 0
    events: int = 0
    misses: int = 0
    unexplained: int = 0  # strikes, plucks and changes that no note causes
    samples: int = 0
    differing: int = 0
    dropped: int = 0
    levels: int = 0  # notes whose levels were compared
    off: int = 0  # of these, more than 1 dB
    off_sounding: int = 0  # of these, with a body that still vibrated


class Instrument:
    """A patch with a keyboard, the tables of its keys, and what was counted."""

    def __init__(self, name: str) -> None:
        self.name, self.scene, self.counts = name, engine.load(name), Counts()
        self.document: dict[str, Any] = self.scene.instrument or {}
        self.writer, self.bodies = KeyWriter(self.document), dict[int, list[str]]()  # of keys, masses apart
        for key in keys_of(self.document["keyboard"]):
            known = len(self.writer.sections["body"])
            self.writer.write_key(key)
            written = self.writer.sections["body"][known:]
            self.bodies[key] = [body["name"] for body in written if body["kind"] != "mass"]
        self.levels = NoteLevels(self.scene, self.bodies)

    def notes_of(self, played: PlayedFile) -> list[LoneNote]:
        """Return the notes of a file in the order of their begins."""
        return NoteRules(self.writer, set(self.bodies)).follow(played.score)


def compare_events(instrument: Instrument, played: PlayedFile, notes: Sequence[LoneNote]) -> Iterator[str]:
    """Count the events of the notes of a file, and yield those that are missing or that no note causes."""
    counts, present = instrument.counts, EventCount(played.scene.event)
    counts.notes += len(notes)
    for note in notes:
        for event in events_alone(instrument.writer, note, played.scene.seconds):
            counts.events += 1
            if not present.take(event):
                counts.misses += 1
                yield f"missing at {event.time:.6f} s, of {describe(note)}: {without_time(event)}"
    for event in instrument.scene.event:  # of the patch itself
        present.take(event)
    for text in present.left():
        counts.unexplained += 1
        yield f"of no note: {text}"


def compare_playing(counts: Counts, scene: Scene) -> None:
    """Count the samples at which a player differs from a rendering, and the events that it drops."""
    audio = np.asarray(engine.render(scene, samplerate=RATE, kernel="general", cores=1).audio)
    player = Player(scene, RATE, math.inf, GAIN, kernel="general")
    player.counters[[Slot.FADE_IN_FRAMES, Slot.END]] = 0, MAX_FRAMES
    heard = np.zeros(audio.shape, np.float32)
    for begin in range(0, len(heard), BLOCK):
        player.render_into(heard[begin : begin + BLOCK])
    counts.samples += audio.size
    counts.differing += int(np.count_nonzero((audio * GAIN).astype(np.float32) != heard))
    counts.dropped += player.meter().dropped


def describe(note: LoneNote) -> str:
    """Return a note as text."""
    return f"{note_name(note.key)} at {note.begin:.4f} s, velocity {round(note.v * FULL_VELOCITY)}"


def check_file(instrument: Instrument, path: Path, played: PlayedFile, most: int) -> None:
    """Count and print what differs at a file."""
    counts, notes = instrument.counts, instrument.notes_of(played)
    counts.files += 1
    begun, where = time.perf_counter(), f"{instrument.name} {path.name}:"
    differing, dropped = counts.differing, counts.dropped
    for text in compare_events(instrument, played, notes):
        print(where, text, flush=True)
    compare_playing(counts, played.scene)
    if (counts.differing, counts.dropped) != (differing, dropped):
        print(where, f"{counts.differing - differing} samples differ, {counts.dropped - dropped} events dropped")
    for level in instrument.levels.compare(played.scene, notes, most):
        counts.levels += 1
        if abs(level.off) > ALLOWED:
            counts.off += 1
            counts.off_sounding += level.before > SOUNDING
            left = f"before it {level.body} at {level.before:.0f} dB"
            change = "" if level.change is None else f"; {level.change:.1f} dB by velocity"
            print(where, f"{level.off:+.1f} dB: {describe(level.note)}; {left}{change}")
    print(where, f"{len(notes)} notes, {time.perf_counter() - begun:.0f} s", flush=True)


def main(words: list[str]) -> int:
    """0 if all events, samples and drops are right, 1 if not, 2 if there is nothing to play."""
    parser = argparse.ArgumentParser("bench notes", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="with MIDI files, whose names end in .mid")
    parser.add_argument("--patches", default=PATCHES, help=f"instruments (default: {PATCHES})")
    parser.add_argument("--seconds", type=float, default=6.0, help="of each file (default: 6)")
    parser.add_argument("--files", type=int, default=20, help="how many are played, by name (default: 20)")
    parser.add_argument("--levels", type=int, default=40, help="how many of a file are compared at most (default: 40)")
    told = parser.parse_args(words)
    instruments = [Instrument(name) for name in told.patches.split(",")]
    for instrument in instruments:
        for path in sorted(told.folder.glob("*.mid")):
            if instrument.counts.files == told.files:
                break
            try:
                played = scene_of_file(instrument.scene, path, Excerpt(seconds=told.seconds))
            except MidiError as error:
                print(f"{instrument.name} {path.name}: left out: {error}", file=sys.stderr)
                continue
            check_file(instrument, path, played, told.levels)
    names = [field.name for field in fields(Counts)]
    print("\npatch".ljust(13), *(f"{name.replace('_', ' '):>12}" for name in names))
    for one in instruments:
        print(f"{one.name:<12}", *(f"{getattr(one.counts, name):>12}" for name in names))
    if not any(one.counts.files for one in instruments):
        return 2
    counted = (one.counts for one in instruments)
    return int(any(c.misses + c.unexplained + c.differing + c.dropped for c in counted))
