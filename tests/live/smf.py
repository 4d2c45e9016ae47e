"""MIDI files written byte by byte: what no library writes, too."""

import struct
from collections.abc import Sequence
from pathlib import Path

from engine.live.instrument_notes import score_of_notes
from engine.live.midi_files import MidiNotes, read_notes

Timed = tuple[int, bytes]  # ticks since the event before, and the bytes of an event
TICKS = 480  # a beat, of half a second


def number(value: int) -> bytes:
    """Return a number of variable length."""
    out = [value & 127]
    while value := value >> 7:
        out.append(value & 127 | 128)
    return bytes(reversed(out))


def events(*timed: Timed) -> bytes:
    """Return events with their times."""
    return b"".join(number(delta) + data for delta, data in timed)


def track(*timed: Timed, end: bool = True, length: int | None = None) -> bytes:
    """Return a track. length: that its head gives, if it is not the true one"""
    body = events(*timed) + (b"\0\xff\x2f\0" if end else b"")
    return b"MTrk" + struct.pack(">I", len(body) if length is None else length) + body


def smf(*tracks: bytes, kind: int | None = None, division: int = TICKS, extra: bytes = b"") -> bytes:
    """Return a file of tracks. extra: more bytes of its header"""
    kind = (1 if len(tracks) > 1 else 0) if kind is None else kind
    head = struct.pack(">HHH", kind, len(tracks), division & 0xFFFF) + extra
    return b"MThd" + struct.pack(">I", len(head)) + head + b"".join(tracks)


def riff(data: bytes) -> bytes:
    """Return a RIFF file around another one."""
    return b"RIFF" + struct.pack("<I", 12 + len(data)) + b"RMIDdata" + struct.pack("<I", len(data)) + data


def on(key: int, velocity: int = 80, channel: int = 1) -> bytes:
    return bytes([0x90 | channel - 1, key, velocity])


def off(key: int, velocity: int = 64, channel: int = 1) -> bytes:
    return bytes([0x80 | channel - 1, key, velocity])


def cc(control: int, value: int, channel: int = 1) -> bytes:
    return bytes([0xB0 | channel - 1, control, value])


def wheel(pitch: int, channel: int = 1) -> bytes:
    """Return a move of the wheel to -8192 to 8191."""
    return bytes([0xE0 | channel - 1, pitch + 8192 & 127, pitch + 8192 >> 7])


def meta(kind: int, data: bytes = b"") -> bytes:
    return bytes([0xFF, kind]) + number(len(data)) + data


def sysex(data: bytes) -> bytes:
    """Return a message to a maker's device. data: after F0, with F7 if it ends"""
    return b"\xf0" + number(len(data)) + data


def rpn(parameter: int, *data: tuple[int, int], channel: int = 1) -> list[Timed]:
    """Return the choice of a registered parameter, and data controllers with their values."""
    chosen = [cc(101, parameter >> 7, channel), cc(100, parameter & 127, channel)]
    return [(0, one) for one in chosen + [cc(*pair, channel) for pair in data]]


def read(data: bytes, folder: Path) -> MidiNotes:
    """Read a file of these bytes."""
    path = folder / "x.mid"
    path.write_bytes(data)
    return read_notes(path)


def lengths(file: MidiNotes) -> list[tuple[int, float, float]]:
    """Return the notes of a file: key, begin and length, s, to the millisecond."""
    notes: Sequence = score_of_notes(file.notes, file.end).notes
    return [(note.key, round(note.time, 3), round(note.duration, 3)) for note in notes]
