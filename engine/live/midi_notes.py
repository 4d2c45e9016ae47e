"""Notes of MIDI files and ports. mido is imported when asked for."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from engine.files import UnreadableFile, read_bytes
from engine.live.mpe import ALL, MpeZones, NoteChannels
from engine.output_files import error_reason
from engine.patch.control_tables import Midi

PEDALS = {64: "sustain", 66: "sostenuto", 67: "soft"}  # by their controllers
PLAIN = Midi()  # how MIDI is understood if a patch does not say
UNKNOWN_RELEASE = 64  # velocity with which a key is let go, where that was not measured
MAX_FILE_BYTES, MAX_MESSAGES = 16_000_000, 1_000_000  # bytes of a file, and how many messages it has at most
MAX_FILE_SECONDS = 36_000.0  # s


class MidiError(RuntimeError):
    """What stands against playing notes, and what would be right."""


class Note(NamedTuple):
    """A message."""

    seconds: float
    kind: str  # on | off | bend | the name of a pedal
    number: int  # of the key
    value: float  # velocity; how far a pedal is down, 0 to 127; how far the pitch is bent, cents
    channels: NoteChannels = NoteChannels(ALL, ALL)  # of an MPE zone, whose bends it follows; or that are bent


class Move(NamedTuple):
    """A move of a controller."""

    kind: str  # of a [[control]]
    number: int  # of the controller, or of the key
    channel: int  # from 1
    value: float  # 0 to 1


class TimedMove(NamedTuple):
    """A move of a controller in a file."""

    seconds: float
    move: Move
    is_of_one_note: bool  # of an MPE zone


class MidiNotes(NamedTuple):
    """What a file says."""

    notes: list[Note]
    ignored: dict[str, int]  # how many messages of other kinds there are
    moves: list[TimedMove]  # that are taken


def load_mido() -> Any:
    """The module mido. Raises MidiError."""
    try:
        import mido
    except ImportError:
        raise MidiError("notes need mido; uv sync --extra midi, or pip install mido python-rtmidi") from None
    return mido


def parse_message(message: Any, seconds: float, zones: MpeZones) -> Note | None:
    """A message as a Note, if it is one."""
    if message.type in ("note_on", "note_off"):
        channels = zones.channels(message.channel + 1)
        if message.type == "note_on" and message.velocity > 0:
            return Note(seconds, "on", message.note, message.velocity, channels)
        return Note(seconds, "off", message.note, message.velocity or UNKNOWN_RELEASE, channels)
    if message.type == "control_change" and message.control in PEDALS:
        return Note(seconds, PEDALS[message.control], 0, message.value)
    if message.type == "pitchwheel":
        channel = message.channel + 1
        return Note(seconds, "bend", 0, zones.bend_cents(channel, message.pitch), zones.channels(channel))
    return None


def parse_move(message: Any) -> Move | None:
    """A message as a move of a controller, if it is one."""
    if message.type == "control_change":
        return Move("cc", message.control, message.channel + 1, message.value / 127)
    if message.type == "pitchwheel":
        return Move("bend", 0, message.channel + 1, (message.pitch + 8192) / 16383)
    if message.type == "aftertouch":
        return Move("pressure", 0, message.channel + 1, message.value / 127)
    if message.type == "polytouch":
        return Move("poly_pressure", message.note, message.channel + 1, message.value / 127)
    return None


def describe_message(message: Any) -> str:
    """What kind of message is ignored; "" of those that say nothing about sound."""
    if message.is_meta or message.type in ("sysex", "clock", "active_sensing"):
        return ""
    if message.type == "control_change":
        return f"controller {message.control}"
    return str(message.type.replace("_", " "))


def read_notes(path: Path, midi: Midi = PLAIN, takes: Callable[[Move], bool] = lambda move: False) -> MidiNotes:
    """The notes of a .mid file, all tracks together; the file begins at 0. Raises MidiError.

    midi:  how it is understood
    takes: which moves of controllers are taken, too
    """
    file, notes, seconds, ignored = open_midi_file(path), list[Note](), 0.0, dict[str, int]()
    zones, moves = MpeZones(midi), list[TimedMove]()
    try:
        for message in file:
            seconds += message.time
            if zones.feed(message):
                continue
            move = parse_move(message)
            if is_taken := move is not None and takes(move):
                moves.append(TimedMove(seconds, move, zones.is_of_one_note(move.channel)))
            if (note := parse_message(message, seconds, zones)) and not (is_taken and note.kind == "bend"):
                notes.append(note)
            elif not is_taken and (kind := describe_message(message)):
                ignored[kind] = ignored.get(kind, 0) + 1
    except Exception as error:  # whatever mido stumbles over
        raise unreadable_file(path, error) from error
    if not 0.0 <= seconds <= MAX_FILE_SECONDS:
        raise MidiError(f"{path} lasts {seconds / 3600:.3g} hours; at most {MAX_FILE_SECONDS / 3600:g}")
    if not any(note.kind == "on" for note in notes):
        raise MidiError(f"{path} has no notes")
    return MidiNotes(notes, ignored, moves)


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
        raise MidiError(f"{path} has {count} messages; at most {MAX_MESSAGES}")
    return file


def unreadable_file(path: Path, error: Exception) -> MidiError:
    """That a file is no MIDI, in a line."""
    reason = " ".join(error_reason(error).split()) or type(error).__name__
    return MidiError(f"{path} cannot be read as MIDI ({reason[:200]})")


def open_port(name: str) -> Any:
    """An open input port of a name, or of a part of it. Raises MidiError."""
    mido = load_mido()
    try:
        names = mido.get_input_names()
    except (ImportError, OSError) as error:
        raise MidiError(f"no MIDI ports ({error}); uv sync --extra midi, or give a .mid file") from error
    chosen = [n for n in names if name.lower() in n.lower()]
    if len(chosen) != 1:
        what = "several MIDI ports match" if chosen else "no MIDI port is called"
        raise MidiError(
            f'{what} "{name}"; the ports are {", ".join(names) or "none"}; give one of these, or a .mid file'
        )
    return mido.open_input(chosen[0])
