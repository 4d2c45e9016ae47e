"""A file that follows the clock of a MIDI port: 24 ticks a quarter note; it begins, stops and goes on as the port says.

A note sounds when its place in the song has come. Between two ticks time goes on as fast as between the last two, but
never beyond the next: if a cable is pulled, the song waits.
"""

import time
from collections.abc import Callable
from typing import Any

from engine.live.controls import Controls
from engine.live.midi import Allocator, MidiFilePlayer, read_for
from engine.live.midi_drivers import MidiError, open_port
from engine.live.midi_files import MidiNotes
from engine.live.midi_notes import Note
from engine.live.midi_parts import ALL_NOTES, Excerpt

TICKS_PER_BEAT = 24  # of the clock
TICKS_PER_PLACE = 6  # of a song position pointer
ROUNDING = 1e-6  # quarter notes


class MidiClock:
    """The place in a song that a port tells.

    port: an open input of mido
    now:  tells the time, s
    """

    def __init__(self, port: Any, now: Callable[[], float] = time.monotonic) -> None:
        self._port, self._now = port, now
        self._ticks, self._since, self._period = -1, 0.0, 0.0  # of the song, when the last came, and how far apart, s
        self.is_running = False
        self.jump: float | None = None  # the place that was told, in quarter notes, until it is taken

    def poll(self) -> None:
        """Take what has come."""
        for message in self._port.iter_pending():
            self._take(message)

    def _take(self, message: Any) -> None:
        now = self._now()
        if message.type == "clock" and self.is_running:
            self._period = now - self._since if self._ticks >= 0 else 0.0
            self._ticks, self._since = self._ticks + 1, now
        elif message.type in ("start", "songpos"):  # the first tick is at the place that is told
            ticks = TICKS_PER_PLACE * (message.pos if message.type == "songpos" else 0)
            self._ticks, self._period, self.jump = ticks - 1, 0.0, ticks / TICKS_PER_BEAT
        if message.type in ("start", "continue"):
            self.is_running = True
        elif message.type == "stop":
            self.is_running = False

    @property
    def beats(self) -> float:
        """The place in the song, in quarter notes; below 0 until the first tick has come."""
        share = 0.0
        if self.is_running and self._period > 0.0:
            share = min(1.0, (self._now() - self._since) / self._period)
        return (self._ticks + share) / TICKS_PER_BEAT


class ClockedFilePlayer(MidiFilePlayer):
    """The notes of a file, and the moves that its controls take, at the places of the song that a clock tells."""

    def __init__(self, keys: Allocator, file: MidiNotes, clock: MidiClock, controls: Controls) -> None:
        super().__init__(keys, file, controls=controls)
        self._clock, self._was_running = clock, False
        self._beats = [file.beat_at(event.seconds) for event in self._events]
        self._parts = {note.part for note in file.notes}

    def use(self, keys: Allocator) -> None:
        """Go on with another player, which takes over now."""
        self.keys = keys

    def poll(self) -> bool:
        """Play what has come; returns False, as a clock may begin again."""
        clock = self._clock
        clock.poll()
        if clock.jump is not None or (self._was_running and not clock.is_running):
            for part in self._parts:
                self.keys.release_all(part)
        if clock.jump is not None:
            self._next = sum(beat < clock.jump - ROUNDING for beat in self._beats)
            clock.jump = None
        self._was_running = clock.is_running
        self.keys.controls = self._controls if self._has_moves else None
        while clock.is_running and self._next < len(self._events) and self._beats[self._next] <= clock.beats + ROUNDING:
            event = self._events[self._next]
            if isinstance(event, Note):
                self.keys.play(event)
            else:
                self._move(event)
            self._next += 1
        return False


def open_clocked_file(
    text: str, port: str, keys: Allocator | None, controls: Controls, excerpt: Excerpt = ALL_NOTES
) -> ClockedFilePlayer | None:
    """Open the notes of a file, which follow the clock of a port; None if nothing plays them. port: its name, or a part
    of it. Raises MidiError."""
    if keys is None:
        return None
    file = read_for(controls.scene, text, excerpt)
    if not file.tempos:
        raise MidiError(f"{text} counts seconds and no beats; leave out --clock")
    return ClockedFilePlayer(keys, file, MidiClock(open_port(port)), controls)
