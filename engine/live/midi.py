"""Notes of a MIDI file or port, played by the voices of a scene: live, or rendered."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from engine.live.key_allocator import KeyAllocator
from engine.live.midi_notes import MidiError, Note, open_port, parse_message, read_notes
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.live.voice_allocator import VoiceAllocator, nearest_body, pitched_bodies
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

LEAD_IN = 0.05  # s before the first note of a file that is played live: what comes first fades in
TAIL_SECONDS = 3.0  # s after the last
LOOKAHEAD = 0.2  # s, by which notes of a file are told before they sound
RENDER_GAIN = 1e-6  # gain of a render: single precision is as exact at any, and no limiter is to act

Allocator = VoiceAllocator | KeyAllocator
Source = Callable[[], bool]  # tells what has to be told, and whether all is over


class MidiFilePlayer:
    """The notes of a file, told to keys as their time comes near."""

    def __init__(self, keys: Allocator, notes: list[Note], lead: float = 0.0) -> None:
        self.keys, self._next = keys, 0
        self.notes = [note._replace(seconds=note.seconds + lead) for note in notes]

    @property
    def end(self) -> float:
        """When all has died away, s."""
        return self.notes[-1].seconds + TAIL_SECONDS

    def poll(self) -> bool:
        """Tell the notes of the next moments; returns whether all is over."""
        rate, now = self.keys.player.samplerate, self.keys.player.frame
        while self._next < len(self.notes) and self.notes[self._next].seconds * rate < now + LOOKAHEAD * rate:
            note = self.notes[self._next]
            self.keys.play(note, round(note.seconds * rate))
            self._next += 1
        return now > self.end * rate


def is_file(text: str) -> bool:
    """Whether notes come from a file, and not from a port."""
    return Path(text).suffix.lower() in (".mid", ".midi")


def make_allocator(player: Player, text: str) -> Allocator | None:
    """What gives the notes of a file or a port to a player; None if the score of its scene has them already."""
    if player.patch.instrument is None:
        return VoiceAllocator(player)
    return None if is_file(text) else KeyAllocator(player)


def open_source(text: str, keys: Allocator) -> Source:
    """What has to be called often for the notes of a file or a port to be played. Raises MidiError."""
    if is_file(text):
        return MidiFilePlayer(keys, read_notes(Path(text)).notes, LEAD_IN).poll
    midi_port = open_port(text)

    def poll() -> bool:
        for message in midi_port.iter_pending():
            if note := parse_message(message, 0.0):
                keys.play(note)
        return False

    return poll


def lowest_ratio(text: str, scene: Scene) -> float:
    """Ratio of the lowest pitch that will be played: that of a file's lowest note; for a port, two octaves down."""
    if is_file(text):
        bodies = pitched_bodies(scene)
        notes = read_notes(Path(text)).notes
        bend = min((note.value for note in notes if note.kind == "bend"), default=0.0)
        keys = {note.number for note in notes if note.kind == "on"}
        lowest = min(1.0, *(nearest_body(bodies, key).ratio(key) for key in keys))
        return float(lowest * 2.0 ** (min(bend, 0.0) / 1200.0))
    return 0.25


def render_notes(
    scene: Scene, text: str, samplerate: int, seconds: float | None, voices: int, progress: Any = None
) -> tuple[np.ndarray, Player, VoiceAllocator]:
    """What the notes of a file sound like, in SI units [frames, channels]; the player and what gave the notes to its
    voices, for what they can tell. Raises MidiError."""
    notes, ignored = read_notes(Path(text))
    player = Player(scene, samplerate, math.inf, RENDER_GAIN, voices, lowest_ratio(text, scene))
    player.shared[Slot.FADE_IN_FRAMES] = 0  # a file begins with its first note
    keys = VoiceAllocator(player)
    keys.ignored |= ignored
    sequencer = MidiFilePlayer(keys, notes)
    if seconds is None and sequencer.end > MAX_SECONDS:
        raise MidiError(
            f"{text} lasts {sequencer.end:.0f} s; at most {MAX_SECONDS:g}, such as --seconds {MAX_SECONDS:g} of it"
        )
    frames = round((seconds or sequencer.end) * samplerate)
    out, block = np.zeros((frames, player.channels), np.float32), round(LOOKAHEAD * samplerate / 2)
    for begin in range(0, frames, block):
        sequencer.poll()
        player.render_into(out[begin : begin + block])
        if progress is not None:
            progress(min(1.0, (begin + block) / frames))
    return out / RENDER_GAIN, player, keys
