"""Notes of MIDI files and ports. mido is imported when asked for."""

import io
from pathlib import Path
from typing import Any, NamedTuple

from engine.files import UnreadableFile, read_bytes
from engine.output_files import error_reason

SUSTAIN_PEDAL = 64  # controller
MAX_FILE_BYTES, MAX_MESSAGES = 16_000_000, 1_000_000  # bytes of a file, and how many messages it has at most
MAX_FILE_SECONDS = 36_000.0  # s
PITCH_CLASSES = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"]


class MidiError(RuntimeError):
    """What stands against playing notes, and what would be right."""


class Note(NamedTuple):
    """A message."""

    seconds: float
    kind: str  # on | off | pedal
    number: int  # of the key
    value: int  # velocity, or how far the pedal is down


def load_mido() -> Any:
    """The module mido. Raises MidiError."""
    try:
        import mido
    except ImportError:
        raise MidiError("notes need mido; uv sync --extra midi, or pip install mido python-rtmidi") from None
    return mido


def parse_message(message: Any, seconds: float) -> Note | None:
    """A message as a Note, if it is one."""
    if message.type == "note_on" and message.velocity > 0:
        return Note(seconds, "on", message.note, message.velocity)
    if message.type in ("note_on", "note_off"):
        return Note(seconds, "off", message.note, 0)
    if message.type == "control_change" and message.control == SUSTAIN_PEDAL:
        return Note(seconds, "pedal", 0, message.value)
    return None


def read_notes(path: Path) -> list[Note]:
    """The notes of a .mid file, all tracks together; the file begins at 0. Raises MidiError."""
    file, notes, seconds = open_midi_file(path), list[Note](), 0.0
    try:
        for message in file:
            seconds += message.time
            if note := parse_message(message, seconds):
                notes.append(note)
    except Exception as error:  # whatever mido stumbles over
        raise unreadable_file(path, error) from error
    if not 0.0 <= seconds <= MAX_FILE_SECONDS:
        raise MidiError(f"{path} lasts {seconds / 3600:.3g} hours; at most {MAX_FILE_SECONDS / 3600:g}")
    if not any(note.kind == "on" for note in notes):
        raise MidiError(f"{path} has no notes")
    return notes


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
        raise MidiError(f"{path} is of type {file.type}, whose tracks are pieces of their own; save it as type 0 or 1")
    if file.ticks_per_beat <= 0:
        how = "counts frames of film (SMPTE)" if file.ticks_per_beat < 0 else "has 0 ticks a beat"
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
        raise MidiError(f'{what} "{name}"; there are {", ".join(names) or "none"}; or give a .mid file')
    return mido.open_input(chosen[0])


def note_name(note: int) -> str:
    """Of a key, as 60 is C4."""
    return f"{PITCH_CLASSES[note % 12]}{note // 12 - 1}"


def note_frequency(note: int) -> float:
    """Equal temperament, A4 = 440 Hz."""
    return float(440.0 * 2.0 ** ((note - 69) / 12))
