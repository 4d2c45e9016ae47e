"""Notes of MIDI files. mido is imported when needed."""

import math
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from engine.files import MB, UnreadableFile, is_folder, path_exists, read_bytes
from engine.live.channel_levels import EXPRESSION, PAN, VOLUME, LevelMove
from engine.live.general_midi import DRUM_CHANNEL
from engine.live.midi_drivers import MidiError
from engine.live.midi_notes import (
    FIRST_MODE_MESSAGE,
    NOTES_OFF,
    PEDAL_DOWN,
    UNKNOWN_RELEASE,
    Move,
    Note,
    NothingToPlay,
    bends_of,
    parse_message,
    parse_move,
)
from engine.live.midi_parts import ALL_NOTES, Excerpt, Part, TimedMessage, find_parts, list_parts
from engine.live.midi_reader import Event, MidiSong, NotMidi, describe_mended, read_song
from engine.live.mpe import MpeZones
from engine.output_files import error_reason
from engine.patch.control_tables import Midi

STANDARD_INPUT = "-"
MIDI_ENDINGS = (".mid", ".midi", ".kar", ".smf", ".rmi")
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
    mended: str = ""  # what was wrong with the file, in words
    levels: tuple[LevelMove, ...] = ()  # moves of volume, expression and pan, which are counted as ignored too
    tempos: tuple["Tempo", ...] = ()  # none if the file counts seconds and no beats

    def beat_at(self, seconds: float) -> float:
        """The place in the file, in quarter notes, of what is played at a time (s)."""
        at = self.begin + seconds
        tempo = next((one for one in reversed(self.tempos) if one.seconds <= at), self.tempos[0])
        return tempo.beat + ((at - tempo.seconds) / tempo.seconds_per_beat if tempo.seconds_per_beat else 0.0)


class Tempo(NamedTuple):
    """A tempo of a file, from a place on."""

    seconds: float
    beat: float  # quarter notes from the beginning
    seconds_per_beat: float  # 0 where a file is broken


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
    messages, parts, mended, tempos, _ = read_parts(path, midi, excerpt.tempo)
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
    notes = delay_pedals(reader.notes, midi.shortest_lift)
    if not any(note.kind == "on" for note in notes) and not reader.unknown_drums:
        raise NothingToPlay(f"{path}: there are no notes of {list_parts(played)} in the first {excerpt.seconds:g} s")
    rest = played, left_out, reader.unknown_drums, begin, end, mended, tuple(reader.levels), tempos
    return MidiNotes(notes, reader.ignored, reader.moves, *rest)


def delay_pedals(notes: Sequence[Note], shortest: float) -> list[Note]:
    """Let a sustain pedal that was down be up for the shortest time (s) at least: what moves it down sooner does so
    later. Scores have it go up and down at once where harmonies change, which damps nothing."""
    moved, is_down, lifted = list[Note | None](), dict[int, bool](), dict[int, float]()
    delayed: dict[int, list[tuple[int, float]]] = {}  # of each channel: moves down that come later, and when
    for note in notes:
        if note.kind == "sustain":
            channel, goes_down = note.channels.channel, note.value >= PEDAL_DOWN
            waiting = [one for one in delayed.get(channel, []) if one[1] > note.seconds]
            if goes_down:
                note = note._replace(seconds=max(note.seconds, lifted.get(channel, -math.inf) + shortest))
                waiting.append((len(moved), note.seconds))
            elif waiting:  # it goes up again before it was down
                for n, _ in waiting:
                    moved[n] = None
                waiting = []
            elif is_down.get(channel):
                lifted[channel] = note.seconds
            delayed[channel], is_down[channel] = waiting, goes_down
        moved.append(note)
    return sorted((note for note in moved if note is not None), key=lambda one: one.seconds)


class Song(NamedTuple):
    """A MIDI file.

    messages: in the order of their times
    mended:   what was wrong with it, in words; "" if nothing was
    tempos:   none if it counts seconds and no beats
    lengthening:  how many times as long it is as in the file
    """

    messages: list[TimedMessage]
    parts: list[Part]
    mended: str
    tempos: tuple[Tempo, ...]
    lengthening: float


def read_parts(path: Path, midi: Midi = PLAIN, tempo: float | None = None) -> Song:
    """The messages of a MIDI file, and its parts. Raises MidiError.

    tempo: at the first note, quarter notes per minute, which others follow; None: as in the file
    """
    song = read_file(path)
    messages, tempos, lengthening = time_messages(song), read_tempos(song), 1.0
    if tempo is not None:
        if not tempos:
            raise MidiError(f"{path} counts seconds and no beats; leave out --tempo")
        lengthening = 60.0 / tempo / first_tempo(song, tempos).seconds_per_beat
        messages = [message._replace(seconds=lengthening * message.seconds) for message in messages]
        tempos = tuple(Tempo(lengthening * one.seconds, one.beat, lengthening * one.seconds_per_beat) for one in tempos)
    parts = find_parts(messages, [read_name(track.name) for track in song.tracks], midi)
    if not parts:
        raise MidiError(f"{path} has no notes")
    return Song(messages, parts, describe_mended(song.mended), tempos, lengthening)


def read_name(name: bytes) -> str:
    """The name of a track as it was meant: in UTF-8 or Latin-1, and without what pads it."""
    try:
        text = name.decode("utf-8")
    except UnicodeError:
        text = name.decode("latin-1")
    return text.strip("\0 \t\r\n")


class PartReader:
    """The notes of some parts, and how controllers move on their channels, from the messages of a file."""

    def __init__(
        self, midi: Midi, parts: Sequence[Part], takes: Callable[[Move], bool], drums: Mapping[int, int] | None
    ) -> None:
        self.notes, self.moves, self.ignored = list[Note](), list[TimedMove](), dict[str, int]()
        self.unknown_drums: dict[int, int] = {}
        self.levels = list[LevelMove]()
        self._zones, self._takes, self._drums = MpeZones(midi), takes, drums
        self._numbers = {part.key: number for number, part in enumerate(parts)}
        self._channels = {part.channel for part in parts}
        self._held: dict[tuple[int, int], list[tuple[int, Note]]] = {}  # by channel and key: tracks, and what they hold

    def read(self, seconds: float, track: int, message: Any) -> None:
        """Take a message."""
        for one in self._zones.expand(message):
            if self._zones.feed(one):
                for channel in self._zones.regrouped:  # the release of a key would not find its note in the new zone
                    self._release_all(seconds, channel)
                self.notes += bends_of(self._zones, seconds)
            elif one.type in ("note_on", "note_off"):
                note = parse_message(one, seconds, self._zones)
                if note is not None and note.kind == "on":
                    self._press(note, track, one.channel + 1)
                elif note is not None:
                    self._release(note, track, one.channel + 1)
            elif self._zones.part_channel(one.channel + 1) in self._channels:
                self._move(seconds, one)

    def _press(self, note: Note, track: int, channel: int) -> None:
        """Add a note, of a drum on the key that the patch has for it."""
        part_channel = self._zones.part_channel(channel)
        part = self._numbers.get((track, part_channel))
        if part is None:
            return
        held = self._held.setdefault((channel, note.number), [])
        if self._drums is not None and part_channel == DRUM_CHANNEL:
            if note.number not in self._drums:
                self.unknown_drums[note.number] = self.unknown_drums.get(note.number, 0) + 1
                return
            note = note._replace(number=self._drums[note.number])
        held.append((track, note._replace(part=part)))
        self.notes.append(held[-1][1])

    def _release(self, note: Note, track: int, channel: int) -> None:
        """Let a key go that its own track holds, or else another track on its channel."""
        held = self._held.get((channel, note.number), [])
        if held:
            mine = next((one for one in held if one[0] == track), held[0])
            held.remove(mine)
            self.notes.append(mine[1]._replace(seconds=note.seconds, kind="off", value=note.value))

    def _release_all(self, seconds: float, channel: int) -> None:
        """Let go of all keys of a channel."""
        for (on_channel, _), held in self._held.items():
            if on_channel == channel:
                offs = [note._replace(seconds=seconds, kind="off", value=UNKNOWN_RELEASE) for _, note in held]
                self.notes += offs
                held.clear()

    def _move(self, seconds: float, message: Any) -> None:
        """Take what is no note."""
        move = parse_move(message)
        if is_taken := move is not None and self._takes(move):
            self.moves.append(TimedMove(seconds, move, self._zones.is_of_one_note(move.channel)))
        if message.type == "control_change" and message.control >= FIRST_MODE_MESSAGE:
            self._take_mode(seconds, message)
        elif is_taken and message.type == "pitchwheel":
            return
        elif (note := parse_message(message, seconds, self._zones)) is not None:
            self.notes.append(note)
        elif not is_taken:
            if message.type == "control_change" and message.control in (VOLUME, PAN, EXPRESSION):
                channel = self._zones.part_channel(message.channel + 1)
                self.levels.append(LevelMove(seconds, channel, message.control, message.value))
            kind = describe_message(message)
            self.ignored[kind] = self.ignored.get(kind, 0) + 1

    def _take_mode(self, seconds: float, message: Any) -> None:
        """Take a message to a channel: all sound off, all notes off, a mode."""
        channel = message.channel + 1
        if (note := parse_message(message, seconds, self._zones)) is not None:
            for (on_channel, _), held in self._held.items():
                if on_channel == channel:
                    held.clear()
            self.notes.append(note)
        elif message.control in NOTES_OFF:
            self._release_all(seconds, channel)


def describe_message(message: Any) -> str:
    """Name the kind of a message that is ignored."""
    if message.type == "control_change":
        return f"controller {message.control}"
    return str(message.type.replace("_", " "))


def time_messages(song: MidiSong) -> list[TimedMessage]:
    """The messages of all tracks in the order of their times. At one tick of one key, it is let go before it is
    pressed."""
    events = [(event, number) for number, track in enumerate(song.tracks) for event in track.events]
    events.sort(key=lambda one: one[0].ticks)
    messages, scale, before, seconds = list[TimedMessage](), DEFAULT_TEMPO * 1e-6, 0, 0.0
    held = Counter[tuple[int, int]]()
    for ticks, group in groupby(events, key=lambda one: one[0].ticks):
        tick = song.tick_seconds or scale / song.ticks_per_beat
        seconds, before = seconds + (ticks - before) * tick, ticks
        for event, number in order_offs(list(group), held):
            if event.tempo is None:
                messages.append(TimedMessage(seconds, number, event.message))
            else:
                scale = event.tempo * 1e-6
    return messages


def read_tempos(song: MidiSong) -> tuple[Tempo, ...]:
    """The tempos of a file; none if it counts seconds."""
    if song.tick_seconds:
        return ()
    changes = [(event.ticks, event.tempo) for track in song.tracks for event in track.events if event.tempo is not None]
    tempos = [Tempo(0.0, 0.0, DEFAULT_TEMPO * 1e-6)]
    for ticks, tempo in sorted(changes, key=lambda change: change[0]):
        last, beat = tempos[-1], ticks / song.ticks_per_beat
        tempos.append(Tempo(last.seconds + (beat - last.beat) * last.seconds_per_beat, beat, tempo * 1e-6))
    return tuple(tempos)


def first_tempo(song: MidiSong, tempos: Sequence[Tempo]) -> Tempo:
    """The tempo at the first note."""
    presses = (event.ticks for track in song.tracks for event in track.events if key_of(event) and is_press(event))
    first = min(presses, default=0) / song.ticks_per_beat
    return [tempo for tempo in tempos if tempo.beat <= first and tempo.seconds_per_beat][-1]


def order_offs(events: list[tuple[Event, int]], held: Counter[tuple[int, int]]) -> list[tuple[Event, int]]:
    """Order the events of a tick so that a key that is down is let go before it is pressed again.

    held: how often each key of each channel is pressed before, which is brought up to date
    """
    pressed = {key for event, _ in events if (key := key_of(event)) and is_press(event) and held[key]}
    if pressed:
        earlier = []
        for one in events:
            if (key := key_of(one[0])) in pressed and not is_press(one[0]) and held[key]:
                held[key] -= 1
                earlier.append(one)
        events = earlier + [one for one in events if not any(one is other for other in earlier)]
        rest = events[len(earlier) :]
    else:
        rest = events
    for event, _ in rest:
        if key := key_of(event):
            held[key] = max(0, held[key] + (1 if is_press(event) else -1))
    return events


def key_of(event: Event) -> tuple[int, int] | None:
    """The channel and the key that an event presses or lets go; None if it does neither."""
    message = event.message
    return (message.channel, message.note) if message is not None and message.type in ("note_on", "note_off") else None


def is_press(event: Event) -> bool:
    """True if an event of a key presses it."""
    return bool(event.message.type == "note_on" and event.message.velocity > 0)


def is_midi_file(text: str) -> bool:
    """True if notes come from a file, and not from a port: by the ending of its name, because there is one of this
    name, or from standard input."""
    path = Path(text)
    return text == STANDARD_INPUT or path.suffix.lower() in MIDI_ENDINGS or (path_exists(path) and not is_folder(path))


@cache
def _read_standard_input() -> bytes:
    """Read all of standard input, which is there once."""
    return sys.stdin.buffer.read(MAX_FILE_BYTES + 1)


def read_file(path: Path) -> MidiSong:
    """Read a MIDI file, or standard input if its name is "-". Raises MidiError if it is none, or none that could be
    played."""
    try:
        if str(path) == STANDARD_INPUT:
            data = _read_standard_input()
            if len(data) > MAX_FILE_BYTES:
                raise UnreadableFile(f"is larger than {MAX_FILE_BYTES / MB:g} MB")
        else:
            data = read_bytes(path, MAX_FILE_BYTES)
        song = read_song(data)
    except UnreadableFile as error:
        raise MidiError(f"{path} {error}; give a .mid file") from error
    except (OSError, AttributeError, NotMidi) as error:  # standard input may be none at all
        raise unreadable_file(path, error) from error
    if song.kind not in (0, 1):
        raise MidiError(f"{path} is of type {song.kind}, whose tracks are independent; save it as type 0 or 1")
    if not song.ticks_per_beat and not song.tick_seconds:
        raise MidiError(f"{path} has 0 ticks a beat; save it with ticks per beat, such as 480")
    if song.size > MAX_MESSAGES:
        raise MidiError(f"{path} has {song.size} messages; the limit is {MAX_MESSAGES}")
    return song


def unreadable_file(path: Path, error: Exception) -> MidiError:
    """That a file is no MIDI, in a line."""
    reason = " ".join(error_reason(error).split()) or type(error).__name__
    return MidiError(f"{path} cannot be read as MIDI ({reason[:200]})")
