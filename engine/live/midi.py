"""Notes of a MIDI file or port, played by the voices of a scene: live, or rendered."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from engine.instrument.tables import drum_keys
from engine.live.controls import Controls, takes_move
from engine.live.general_midi import DRUM_CHANNEL
from engine.live.key_allocator import KeyAllocator
from engine.live.midi_files import MidiNotes, read_notes
from engine.live.midi_notes import (
    ALL_NOTES_OFF,
    ALL_SOUND_OFF,
    MidiError,
    open_port,
    parse_message,
    parse_move,
)
from engine.live.midi_parts import ALL_NOTES, Excerpt
from engine.live.mpe import LOWER_MASTER, UPPER_MASTER, MpeZones
from engine.live.player import Player
from engine.live.shared_memory import Gauge, Slot
from engine.live.voice_allocator import VoiceAllocator, nearest_body, pitched_bodies
from engine.patch.frames import nearest_frame
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

LEAD_IN = 0.05  # s before the first note of a file that is played live: what comes first fades in
TAIL_SECONDS = 3.0  # s after the last
LOOKAHEAD = 0.2  # s, by which notes of a file are sent before they sound
CONTROL_SECONDS = 0.005  # blocks of a file that moves controls
RENDER_GAIN = 1e-6  # gain of a render: single precision is as exact at any, and no limiter is to act

Allocator = VoiceAllocator | KeyAllocator
Source = Callable[[], bool]  # tells what has to be told, and whether all is over


class MidiFilePlayer:
    """The notes of a file, and the moves that its controls take, told as their time comes near."""

    def __init__(self, keys: Allocator, file: MidiNotes, lead: float = 0.0, controls: Controls | None = None) -> None:
        self.keys, self._next, self._next_move, self._controls = keys, 0, 0, controls
        self.notes = [note._replace(seconds=note.seconds + lead) for note in file.notes]
        self._moves = [timed._replace(seconds=timed.seconds + lead) for timed in file.moves]

    @property
    def end(self) -> float:
        """When all has died away, s."""
        return self.notes[-1].seconds + TAIL_SECONDS

    def poll(self) -> bool:
        """Tell the notes of the next moments, and the moves up to now; returns whether all is over."""
        rate, now = self.keys.player.samplerate, self.keys.player.frame
        while self._next < len(self.notes) and self.notes[self._next].seconds * rate < now + LOOKAHEAD * rate:
            note = self.notes[self._next]
            self.keys.play(note, nearest_frame(note.seconds, rate))
            self._next += 1
        while self._next_move < len(self._moves) and self._moves[self._next_move].seconds * rate <= now:
            _, move, is_of_one_note = self._moves[self._next_move]
            if self._controls is not None:
                self._controls.move(move, self.keys.targets(move, is_of_one_note))
            self._next_move += 1
        return now > self.end * rate


def is_file(text: str) -> bool:
    """True if notes come from a file, and not from a port."""
    return Path(text).suffix.lower() in (".mid", ".midi")


def make_allocator(player: Player) -> Allocator | None:
    """Make the allocator that gives notes to a player; None if it plays the score of its scene alone. Raises
    MidiError."""
    if player.voices:
        return VoiceAllocator(player)
    return KeyAllocator(player) if player.waiting and player.patch.instrument is not None else None


def has_notes(scene: Scene, text: str) -> bool:
    """True if a patch without a keyboard can play notes. It need not, if a port moves its controls. Raises
    MidiError."""
    try:
        pitched_bodies(scene)
    except MidiError:
        if is_file(text) or all(control.kind == "osc" for control in scene.control):
            raise
        return False
    return True


def open_source(text: str, keys: Allocator | None, controls: Controls, excerpt: Excerpt = ALL_NOTES) -> Source | None:
    """Open the notes of a file or a port; return a function to be called often, which plays them and moves controls.
    None if there is nothing to play. excerpt: of a file. Raises MidiError."""
    if is_file(text):
        if keys is None:
            return None
        return MidiFilePlayer(keys, read_for(controls.scene, text, excerpt), LEAD_IN, controls).poll
    midi_port, zones = open_port(text), MpeZones(controls.scene.midi)

    def poll() -> bool:
        for message in midi_port.iter_pending():
            if not zones.feed(message):
                take_message(message, zones, keys, controls)
        return False

    return poll


def take_message(message: Any, zones: MpeZones, keys: Allocator | None, controls: Controls) -> None:
    """Play the note of a message, or move the controls that it is for."""
    move = parse_move(message)
    if is_taken := move is not None and controls.takes(move):
        assert move is not None
        targets = None if keys is None else keys.targets(move, zones.is_of_one_note(move.channel))
        controls.move(move, targets)
    note = parse_message(message, 0.0, zones)
    if note and note.kind in ("on", "off") and zones.part_channel(message.channel + 1) == DRUM_CHANNEL:
        drums = drum_keys(controls.scene.instrument) or {}
        note = note._replace(number=drums.get(note.number, note.number))
    if note and keys is not None and not (is_taken and note.kind == "bend"):
        keys.play(note._replace(part=message.channel + 1))
    if message.type == "control_change" and keys is not None and not is_taken:
        if message.control == ALL_NOTES_OFF:
            keys.release_all(message.channel + 1)
        elif message.control == ALL_SOUND_OFF:
            keys.silence()


def read_for(scene: Scene, text: str, excerpt: Excerpt = ALL_NOTES) -> MidiNotes:
    """The notes of a file, and the moves that a scene has controls for. Raises MidiError."""
    return read_notes(
        Path(text), scene.midi, lambda move: any(takes_move(control, move) for control in scene.control), excerpt
    )


def lowest_ratio(text: str, scene: Scene, excerpt: Excerpt = ALL_NOTES) -> float:
    """Ratio of the lowest pitch that will be played: that of a file's lowest note; for a port, two octaves down."""
    if is_file(text):
        bodies = pitched_bodies(scene)
        notes = read_for(scene, text, excerpt).notes
        bends: dict[int, float] = {}
        for note in notes:
            if note.kind == "bend":
                bends[note.channels.channel] = min(note.value, bends.get(note.channels.channel, 0.0))
        masters = [bends.pop(channel, 0.0) for channel in (LOWER_MASTER, UPPER_MASTER)]
        bend = min(bends.values(), default=0.0) + min(masters)
        keys = {note.number for note in notes if note.kind == "on"}
        lowest = min(1.0, *(nearest_body(bodies, key).ratio(key) for key in keys))
        return float(lowest * 2.0 ** (bend / 1200.0))
    return 0.25


class RenderedNotes(NamedTuple):
    """The notes of a file as sound."""

    audio: np.ndarray  # SI units, [frames, channels]
    player: Player
    keys: VoiceAllocator
    file: MidiNotes


def render_notes(
    scene: Scene,
    text: str,
    samplerate: int,
    seconds: float | None,
    voices: int,
    progress: Any = None,
    excerpt: Excerpt = ALL_NOTES,
) -> RenderedNotes:
    """Render the notes of a file, from the first of them on. seconds: how many of them. Raises MidiError."""
    excerpt = replace(excerpt, seconds=seconds)
    file = read_for(scene, text, excerpt)
    lowest = lowest_ratio(text, scene, excerpt)
    player = Player(scene, samplerate, math.inf, RENDER_GAIN, voices=voices, lowest=lowest)
    player.counters[Slot.FADE_IN_FRAMES] = 0  # it begins with a note
    keys = VoiceAllocator(player)
    keys.ignored |= file.ignored
    controls = Controls(scene, player)
    sequencer = MidiFilePlayer(keys, file, controls=controls)
    if seconds is None and sequencer.end > MAX_SECONDS:
        raise MidiError(
            f"{text} lasts {sequencer.end:.0f} s; the limit is {MAX_SECONDS:g} s: give --seconds {MAX_SECONDS:g}"
        )
    frames = nearest_frame(seconds or sequencer.end, samplerate)
    seconds_of_block = CONTROL_SECONDS if file.moves else LOOKAHEAD / 2
    out, block = np.zeros((frames, player.channels), np.float32), nearest_frame(seconds_of_block, samplerate)
    for begin in range(0, frames, block):
        started = time.perf_counter()
        sequencer.poll()
        controls.poll()
        player.render_into(out[begin : begin + block])
        player.gauges[Gauge.SECONDS_USED] += time.perf_counter() - started
        if progress is not None:
            progress(min(1.0, (begin + block) / frames))
    return RenderedNotes(out / RENDER_GAIN, player, keys, file)
