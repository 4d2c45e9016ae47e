"""The messages of a MIDI port as a file, beside a recording of the sound."""

from pathlib import Path
from typing import Any

from engine.live.player import Player
from engine.output_files import atomic_write

TICKS, TEMPO = 24_000, 500_000  # per beat; microseconds per beat: a tick is 1/48000 s


class MidiRecording:
    """Keeps messages and when they were played, and saves them as a MIDI file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._messages: list[tuple[float, Any]] = []
        self._player: Player | None = None
        self._before = 0  # frames that other players have played

    def add(self, message: Any, player: Player) -> None:
        """Keep a message (of mido), which a player plays now."""
        if self._player is not player:
            self._before += 0 if self._player is None else self._player.frame
            self._player = player
        self._messages.append(((self._before + player.frame) / player.samplerate, message))

    def save(self) -> None:
        """Write the file. Raises OSError."""
        from mido import MetaMessage, MidiFile, MidiTrack

        file, now = MidiFile(type=0, ticks_per_beat=TICKS), 0
        track = MidiTrack([MetaMessage("set_tempo", tempo=TEMPO)])
        for seconds, message in self._messages:
            tick = max(now, round(seconds * TICKS * 1e6 / TEMPO))
            track.append(message.copy(time=tick - now))
            now = tick
        file.tracks.append(track)
        with atomic_write(self.path) as path:
            file.save(path)
