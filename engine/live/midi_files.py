"""Notes of MIDI files. mido is imported when needed."""

import io
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from engine.files import UnreadableFile, read_bytes
from engine.live.general_midi import DRUM_CHANNEL
from engine.live.midi_notes import MidiError, Move, Note, NothingToPlay, load_mido, parse_message, parse_move
from engine.live.midi_parts import ALL_NOTES, Excerpt, Part, TimedMessage, find_parts, list_parts
from engine.live.mpe import MpeZones
from engine.output_files import error_reason
from engine.patch.control_tables import Midi

PLAIN = Midi()  # how MIDI is understood if a patch does not say
DEFAULT_TEMPO = 500_000  # microseconds per beat, until a file sets another
MAX_FILE_BYTES, MAX_MESSAGES = 16_000_000, 1_000_000  # bytes of a file, and how many messages it has at most
MAX_FILE_SECONDS = 36_000.0  # s
HELD_SECONDS = 1.0  # s, for which keys that are never released are held after the last message


class TimedMove(NamedTuple):
    """A move of a controller in a file."""

    seconds: float
    move: Move
    is_of_one_note: bool  # of an MPE zone


class MidiNotes(NamedTuple):
    """The notes of a file that are played. Times count from the first of them."""

    notes: list[Note]
    ignored: dict[str, int]  # how many messages of other kinds there are
    moves: list[TimedMove]  # that are taken
    parts: list[Part]  # that are played
    left_out: list[Part]  # that General MIDI says are not for the patch
    unknown_drums: dict[int, int]  # notes of drums that the patch has not, by their keys
    begin: float  # of the first note in the file, s
    end: float  # when keys that are not released are, s


def read_notes(
    path: Path,
    midi: Midi = PLAIN,
    takes: Callable[[Move], bool] = lambda move: False,
    excerpt: Excerpt = ALL_NOTES,
    drums: Mapping[int, int] | None = None,
) -> MidiNotes:
    """The notes of a .mid file. Raises MidiError.

    midi:    how it is understood
    takes:   which moves of controllers are taken, too
    excerpt: what of the file is played
    drums:   of a patch of drums, its keys by those of General MIDI's drums
    """
    messages, parts = read_parts(path, midi)
    try:
        played, left_out = excerpt.choose(parts, drums is not None)
    except MidiError as error:
        raise MidiError(f"{path}: {error}") from None
    if not played:
        raise MidiError(f"{path} has only notes of drums (channel 10); give a patch of drums, or --channels 10")
    begin = min(part.begin for part in played) if excerpt.begin is None else excerpt.begin
    reader = PartReader(midi, played, takes, drums)
    end = math.inf if excerpt.seconds is None else excerpt.seconds
    seconds = 0.0
    for at, track, message in messages:
        seconds = max(0.0, at - begin)
        if seconds >= end:
            break
        reader.read(seconds, track, message)
    else:
        if not seconds <= MAX_FILE_SECONDS:
            hours = MAX_FILE_SECONDS / 3600
            raise MidiError(f"{path} lasts {seconds / 3600:.3g} hours; the limit is {hours:g} hours: give --seconds")
        end = max((note.seconds for note in reader.notes), default=0.0) + HELD_SECONDS
    if not any(note.kind == "on" for note in reader.notes) and not reader.unknown_drums:
        raise NothingToPlay(f"{path}: there are no notes of {list_parts(played)} in the first {excerpt.seconds:g} s")
    return MidiNotes(reader.notes, reader.ignored, reader.moves, played, left_out, reader.unknown_drums, begin, end)


def read_parts(path: Path, midi: Midi = PLAIN) -> tuple[list[TimedMessage], list[Part]]:
    """The messages of a .mid file in the order of their times, and its parts. Raises MidiError."""
    file = open_midi_file(path)
    try:
        messages = time_messages(file)
        parts = find_parts(messages, [read_name(track.name) for track in file.tracks], midi)
    except Exception as error:  # whatever mido stumbles over
        raise unreadable_file(path, error) from error
    if not parts:
        raise MidiError(f"{path} has no notes")
    return messages, parts


def read_name(name: str) -> str:
    """The name of a track as it was meant: mido reads all text as Latin-1; many programs write UTF-8, and pad names."""
    with suppress(UnicodeError):
        name = name.encode("latin-1").decode("utf-8")
    return name.strip("\0 \t\r\n")


class PartReader:
    """The notes of some parts, and how controllers move on their channels, from the messages of a file."""

    def __init__(
        self, midi: Midi, parts: Sequence[Part], takes: Callable[[Move], bool], drums: Mapping[int, int] | None
    ) -> None:
        self.notes, self.moves, self.ignored = list[Note](), list[TimedMove](), dict[str, int]()
        self.unknown_drums: dict[int, int] = {}
        self._zones, self._takes, self._drums = MpeZones(midi), takes, drums
        self._numbers = {part.key: number for number, part in enumerate(parts)}
        self._channels = {part.channel for part in parts}

    def read(self, seconds: float, track: int, message: Any) -> None:
        """Take a message."""
        if self._zones.feed(message) or not hasattr(message, "channel"):
            return
        channel = self._zones.part_channel(message.channel + 1)
        if message.type in ("note_on", "note_off"):
            part = self._numbers.get((track, channel))
            note = parse_message(message, seconds, self._zones)
            if part is not None and note is not None:
                self._add(note._replace(part=part), channel)
        elif channel in self._channels:
            self._move(seconds, message)

    def _add(self, note: Note, channel: int) -> None:
        """Add a note, of a drum on the key that the patch has for it."""
        if self._drums is not None and channel == DRUM_CHANNEL:
            if note.number not in self._drums:
                self.unknown_drums[note.number] = self.unknown_drums.get(note.number, 0) + (note.kind == "on")
                return
            note = note._replace(number=self._drums[note.number])
        self.notes.append(note)

    def _move(self, seconds: float, message: Any) -> None:
        """Take what is no note."""
        move = parse_move(message)
        if is_taken := move is not None and self._takes(move):
            self.moves.append(TimedMove(seconds, move, self._zones.is_of_one_note(move.channel)))
        if (note := parse_message(message, seconds, self._zones)) and not (is_taken and note.kind == "bend"):
            self.notes.append(note)
        elif not is_taken:
            kind = describe_message(message)
            self.ignored[kind] = self.ignored.get(kind, 0) + 1


def describe_message(message: Any) -> str:
    """Name the kind of a message that is ignored."""
    if message.type == "control_change":
        return f"controller {message.control}"
    return str(message.type.replace("_", " "))


def time_messages(file: Any) -> list[TimedMessage]:
    """The messages of all tracks in the order of their times. file: as mido has it"""
    tick2second, ticks = load_mido().tick2second, list[TimedMessage]()
    for number, track in enumerate(file.tracks):
        now = 0
        for message in track:
            now += message.time
            ticks.append(TimedMessage(now, number, message))
    ticks.sort(key=lambda timed: timed.seconds)
    messages, tempo, before, seconds = list[TimedMessage](), DEFAULT_TEMPO, 0.0, 0.0
    for at, number, message in ticks:
        if at > before:
            seconds, before = seconds + tick2second(at - before, file.ticks_per_beat, tempo), at
        messages.append(TimedMessage(seconds, number, message))
        if message.type == "set_tempo":
            tempo = message.tempo
    return messages


def open_midi_file(path: Path) -> Any:
    """A .mid file as mido has it. Raises MidiError if it is none, or none that could be played."""
    mido = load_mido()
    try:
        file = mido.MidiFile(file=io.BytesIO(read_bytes(path, MAX_FILE_BYTES)))
    except UnreadableFile as error:
        raise MidiError(f"{path} {error}; give a .mid file") from error
    except Exception as error:
        raise unreadable_file(path, error) from error
    if file.type not in (0, 1):
        raise MidiError(f"{path} is of type {file.type}, whose tracks are independent; save it as type 0 or 1")
    if file.ticks_per_beat <= 0:
        how = "uses SMPTE time" if file.ticks_per_beat < 0 else "has 0 ticks a beat"
        raise MidiError(f"{path} {how}; save it with ticks per beat, such as 480")
    if (count := sum(map(len, file.tracks))) > MAX_MESSAGES:
        raise MidiError(f"{path} has {count} messages; the limit is {MAX_MESSAGES}")
    return file


def unreadable_file(path: Path, error: Exception) -> MidiError:
    """That a file is no MIDI, in a line."""
    reason = " ".join(error_reason(error).split()) or type(error).__name__
    return MidiError(f"{path} cannot be read as MIDI ({reason[:200]})")
