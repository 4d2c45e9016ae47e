"""Parts of a MIDI file, each the notes of a track on a channel, and the choice of those that are played."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from engine.live.general_midi import DRUM_CHANNEL, PROGRAMS
from engine.live.midi_drivers import MidiError
from engine.live.mpe import MpeZones
from engine.patch.control_tables import Midi
from engine.wording import format_value

MAX_LISTED_PARTS = 16
MAX_NAME_CHARACTERS = 40

PartKey = tuple[int, int]  # the track and the channel of a part


class TimedMessage(NamedTuple):
    """A message of a file, as mido has it."""

    seconds: float
    track: int  # from 0
    message: Any


class Part(NamedTuple):
    """The notes of a track on a channel. All channels of an MPE zone are one part."""

    track: int  # from 0
    channel: int  # from 1; of an MPE zone, its master
    name: str  # of the track
    program: int | None  # of General MIDI, from 0; None if the file names none
    begin: float  # of its first note, s
    notes: int  # how many

    @property
    def key(self) -> PartKey:
        """Its track and its channel."""
        return self.track, self.channel

    @property
    def is_drums(self) -> bool:
        """True if its notes are drums of General MIDI."""
        return self.channel == DRUM_CHANNEL

    def is_on_track(self, track: str) -> bool:
        """True if it is of a track, given by its number or its name."""
        return self.track == int(track) if track.isdecimal() else self.name.casefold() == track.casefold()

    def __str__(self) -> str:
        name = f" {format_value(self.name, MAX_NAME_CHARACTERS)}" if self.name else ""
        program = "" if self.program is None else f", {PROGRAMS[self.program]}"
        return f"track {self.track}{name} (channel {self.channel}{', drums' if self.is_drums else program})"


@dataclass(frozen=True)
class Excerpt:
    """The parts of a file that are played. If nothing is chosen, that is all parts but drums; on a patch of drums, the
    drums."""

    channels: frozenset[int] = frozenset()  # from 1
    tracks: tuple[str, ...] = ()  # numbers, from 0, or names
    parts: frozenset[PartKey] | None = None  # instead of channels and tracks
    begin: float | None = None  # in the file, s; at the first note that is played if None
    seconds: float | None = None  # how long it is; to the end if None
    tempo: float | None = None  # at the first note, quarter notes per minute; as in the file if None

    def choose(self, parts: Sequence[Part], plays_drums: bool) -> tuple[list[Part], list[Part]]:
        """Divide the parts of a file into those that are played, and those that General MIDI says are not for the
        patch: drums for one that is pitched, and others for one of drums. Raises MidiError if a channel or track that
        is chosen has no notes.

        plays_drums: whether the patch is one of drums
        """
        if self.parts is not None:
            return [part for part in parts if part.key in self.parts], []
        for channel in sorted(self.channels - {part.channel for part in parts}):
            raise MidiError(f"there are no notes on channel {channel}; the parts are {list_parts(parts)}")
        for track in self.tracks:
            if not any(part.is_on_track(track) for part in parts):
                raise MidiError(f"there are no notes on track {track}; the parts are {list_parts(parts)}")
        if self.tracks:
            parts = [part for part in parts if any(part.is_on_track(track) for track in self.tracks)]
        if self.channels:
            return [part for part in parts if part.channel in self.channels], []
        plays_drums = plays_drums and any(part.is_drums for part in parts)
        chosen = [part for part in parts if part.is_drums == plays_drums]
        return chosen, [part for part in parts if part.is_drums != plays_drums]


ALL_NOTES = Excerpt()


def list_parts(parts: Sequence[Part]) -> str:
    """The parts as one line; only the first of them, if they are many."""
    text = "; ".join(str(part) for part in parts[:MAX_LISTED_PARTS])
    return text if len(parts) <= MAX_LISTED_PARTS else f"{text} and {len(parts) - MAX_LISTED_PARTS} more"


def find_parts(messages: Iterable[TimedMessage], names: Sequence[str], midi: Midi) -> list[Part]:
    """The parts of a file, by track and channel. names: of the tracks"""
    zones, parts = MpeZones(midi), dict[PartKey, Part]()
    programs: dict[PartKey | int, int] = {}  # of a part, and of a channel on any track
    for seconds, track, message in messages:
        if zones.feed(message):
            continue
        if message.type == "program_change":
            channel = message.channel + 1
            programs[track, channel] = programs[channel] = message.program
        elif message.type == "note_on" and message.velocity > 0:
            channel = zones.part_channel(message.channel + 1)
            program = programs.get((track, channel), programs.get(channel))
            fresh = Part(track, channel, names[track], program, seconds, 0)
            part = parts.setdefault(fresh.key, fresh)
            parts[part.key] = part._replace(notes=part.notes + 1)
    return sorted(parts.values())
