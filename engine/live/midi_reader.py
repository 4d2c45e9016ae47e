"""Standard MIDI files as people have them: what is broken is skipped, clipped or read on from the next event."""

from collections import Counter
from typing import Any, NamedTuple

from engine.live.midi_tuning import is_tuning

HEADER, TRACK = b"MThd", b"MTrk"
HEADER_BYTES, CHUNK_BYTES = 6, 8  # of the header's data, of the name and length of a chunk
MAX_NUMBER_BYTES, MAX_NUMBER = 4, 0x0FFFFFFF  # of a number of variable length
META, SYSEX, SYSEX_GOES_ON, END_OF_SYSEX = 0xFF, 0xF0, 0xF7, 0xF7
NAME, END_OF_TRACK, TEMPO = 0x03, 0x2F, 0x51  # meta events
CHANNEL_DATA_BYTES = (2, 2, 2, 2, 1, 1, 2)  # of the messages 0x8n to 0xEn
COMMON_DATA_BYTES = {0xF1: 1, 0xF2: 2, 0xF3: 1}  # of other messages, where they have any
KEYED = (0x80, 0x90, 0xA0)  # messages whose first byte is a key: one that there is not is no key
DROP_FRAME_RATE = 30 / 1.001  # frames per second that SMPTE calls 29
EVENTS_IN_STEP = 3  # that must follow each other where reading goes on


class Event(NamedTuple):
    """An event of a track: a message on a channel, as mido has it, or a tempo."""

    ticks: int  # from the beginning
    message: Any
    tempo: int | None  # microseconds per beat


class Track(NamedTuple):
    """A track of a file."""

    name: bytes
    events: list[Event]


class MidiSong(NamedTuple):
    """A MIDI file as it was understood.

    ticks_per_beat: of the time of tempos; 0 if ticks have seconds of their own
    tick_seconds:   of SMPTE time, s; 0.0 if ticks are parts of a beat
    size:           how many events it has, with those that are of no use here
    mended:         what was wrong, in words, with how often
    """

    kind: int
    ticks_per_beat: int
    tick_seconds: float
    tracks: list[Track]
    size: int
    mended: Counter[str]


class NotMidi(ValueError):
    """Bytes that are no MIDI file. The message says why."""


def read_song(data: bytes) -> MidiSong:
    """Read a Standard MIDI File, alone or in a RIFF file or with other bytes around it. Raises NotMidi, MidiError."""
    begin, mended = data.find(HEADER), Counter[str]()
    if begin < 0:
        raise NotMidi("MThd not found")
    if begin and data[:4] != b"RIFF":
        mended["bytes before the header"] += begin
    first = data.find(TRACK, begin)
    length = int.from_bytes(data[begin + 4 : begin + CHUNK_BYTES], "big")
    head = data[begin + CHUNK_BYTES :][: min(length, HEADER_BYTES)]
    if first < 0 or len(head) < HEADER_BYTES or first < begin + CHUNK_BYTES + HEADER_BYTES:
        raise NotMidi("its header is too short" if first >= 0 else "it has no track")
    kind, division = int.from_bytes(head[:2], "big"), int.from_bytes(head[4:], "big")
    at = begin + CHUNK_BYTES + length
    if at > first:
        at, mended["length of the header"] = first, 1
    ticks, seconds = _division(division)
    tracks, count = list[Track](), 0
    while (at := _find_track(data, at, mended)) >= 0:
        reader = TrackReader(data, at, mended)
        at = reader.read()
        tracks.append(Track(reader.name, reader.events))
        count += reader.count
    return MidiSong(kind, ticks, seconds, tracks, count, mended)


def _division(division: int) -> tuple[int, float]:
    """The ticks per beat, or the seconds of a tick of SMPTE time; 0 for what is not used."""
    if not division & 0x8000:
        return division, 0.0
    frames, ticks = 256 - (division >> 8), division & 0xFF
    rate = DROP_FRAME_RATE if frames == 29 else float(frames)
    return 0, 1.0 / (rate * ticks) if ticks else 0.0


def _find_track(data: bytes, at: int, mended: Counter[str]) -> int:
    """Return the position of the next track, beyond chunks of other kinds; -1 if there is none."""
    while 0 <= at <= len(data) - CHUNK_BYTES:
        if data[at : at + 4] == TRACK:
            return at
        beyond = at + CHUNK_BYTES + int.from_bytes(data[at + 4 : at + CHUNK_BYTES], "big")
        following = data.find(TRACK, at)
        if following < 0:
            return -1
        if not _is_name(data[at : at + 4]) or following < beyond:
            mended["bytes between tracks"] += following - at
            return following
        at = beyond
    return -1


def _is_name(name: bytes) -> bool:
    return len(name) == 4 and all(32 <= byte < 127 for byte in name)


class TrackReader:
    """The events of a track. What cannot be understood is skipped, up to where events follow each other again."""

    def __init__(self, data: bytes, begin: int, mended: Counter[str]) -> None:
        from mido import Message

        self.name, self.events, self.count = b"", list[Event](), 0
        self._data, self._mended, self._make = data, mended, Message.from_bytes
        self._at = begin + CHUNK_BYTES
        self._chunk_end = self._at + int.from_bytes(data[begin + 4 : self._at], "big")
        self._end = min(len(data), self._chunk_end)  # of what is read
        self._now, self._status, self._is_over = 0, 0, False

    def read(self) -> int:
        """Read all events. Returns where the next chunk may begin."""
        while not self._is_over:
            if self._at >= self._end and not self._extend():
                break
            begin, now = self._at, self._now
            try:
                self._read_event()
            except (IndexError, ValueError) as error:
                self._at, self._now = begin, now
                if isinstance(error, IndexError) and self._extend():
                    continue
                if self._is_cut(error):
                    break
                self._resynchronise()
        if self._chunk_end > len(self._data) and not self._is_over:
            self._mended["a track that is cut off"] += 1
        following = self._data.find(TRACK, self._at)
        if self._is_over and self._at < self._chunk_end and 0 <= following < self._chunk_end:
            self._mended["a wrong length of a track"] += 1
            return following
        return max(self._at, min(self._chunk_end, len(self._data)))

    def _extend(self) -> bool:
        """Go on beyond the end of a chunk whose length is too small: no other chunk begins there, and no event has
        ended the track. Returns whether there is more."""
        end = self._end
        if end + CHUNK_BYTES > len(self._data) or _is_name(self._data[end : end + 4]) or not self.events:
            return False
        following = self._data.find(TRACK, end)
        beyond = following if following >= 0 else len(self._data)
        if not self._reads_on(self._at, beyond, self._status):
            return False
        self._mended["a wrong length of a track"] += 1
        self._end = beyond
        return True

    def _is_cut(self, error: Exception) -> bool:
        """True if an event is cut by the end of the file, with which all is over."""
        return isinstance(error, IndexError) and self._end == len(self._data) and self._chunk_end > self._end

    def _resynchronise(self) -> None:
        """Skip to where events follow each other, or to the end."""
        begin = self._at
        self._at = next((at for at in range(begin + 1, self._end) if self._reads_on(at, self._end)), self._end)
        self._mended["bytes that are no events"] += self._at - begin

    def _reads_on(self, at: int, end: int, running: int = 0) -> bool:
        """True if some events, or those up to the end, can be read from a position on. running: the status that goes
        on; if it is 0, the first event has one"""
        data, count = self._data, 0
        try:
            while at < end and count < EVENTS_IN_STEP:
                _, at = self._number(at, end)
                status = data[at]
                if status < 0x80 and not running:
                    return False
                if status < 0x80:
                    at -= 1
                elif status in (META, SYSEX, SYSEX_GOES_ON):
                    if status == META and data[at + 1] > 0x7F:
                        return False
                    length, after = self._number(at + 1 + (status == META), end)
                    if after + length > end:
                        return False
                    if status == META and data[at + 1] == END_OF_TRACK:
                        return length == 0
                    at, count = after + length, count + 1
                    continue
                elif status > 0xEF:
                    return False
                else:
                    running = status
                size = CHANNEL_DATA_BYTES[(running >> 4) - 8]
                if at + 1 + size > end or any(byte > 0x7F for byte in data[at + 1 : at + 1 + size]):
                    return False
                at, count = at + 1 + size, count + 1
        except (IndexError, ValueError):
            return False
        return count > 0

    def _number(self, at: int, end: int) -> tuple[int, int]:
        """A number of variable length, and where it ends. Raises IndexError at the end, ValueError if too long."""
        value = 0
        for n in range(at, at + MAX_NUMBER_BYTES):
            if n >= end:
                raise IndexError
            byte = self._data[n]
            value = value << 7 | byte & 0x7F
            if byte < 0x80:
                return value, n + 1
        raise ValueError

    def _byte(self, at: int) -> int:
        if at >= self._end:
            raise IndexError
        return self._data[at]

    def _read_event(self) -> None:
        """Read an event. Raises IndexError if it goes beyond the end, ValueError if it is none."""
        delta, at = self._number(self._at, self._end)
        status = self._byte(at)
        if status == META:
            self._read_meta(at + 1, delta)
        elif status in (SYSEX, SYSEX_GOES_ON):
            length, at = self._number(at + 1, self._end)
            if at + length > self._end:
                raise ValueError
            self._take(at + length, delta)
            data = self._data[at : at + length].removesuffix(bytes([END_OF_SYSEX]))
            if status == SYSEX and is_tuning(data) and max(data) <= 0x7F:
                self.events.append(Event(self._now, self._make([SYSEX, *data, END_OF_SYSEX]), None))
        elif status > 0xEF:
            self._take(at + 1 + COMMON_DATA_BYTES.get(status, 0), delta)
        else:
            if status < 0x80:  # running status goes on after other events too, as many writers have it
                if not self._status:
                    raise ValueError
                at, status = at - 1, self._status
            size = CHANNEL_DATA_BYTES[(status >> 4) - 8]
            self._byte(at + size)
            self._status = status
            self._take(at + 1 + size, delta)
            self._add_message(status, self._data[at + 1 : at + 1 + size])

    def _take(self, at: int, delta: int) -> None:
        """Go on after an event."""
        self._at, self._now, self.count = at, self._now + delta, self.count + 1

    def _read_meta(self, at: int, delta: int) -> None:
        kind = self._byte(at)
        length, at = self._number(at + 1, self._end)
        if at + length > self._end:
            raise ValueError
        data = self._data[at : at + length]
        self._take(at + length, delta)
        if kind == END_OF_TRACK:
            self._is_over = True
        elif kind == TEMPO and length == 3:
            self.events.append(Event(self._now, None, int.from_bytes(data, "big")))
        elif kind == TEMPO:
            self._mended["a tempo that is none"] += 1
        elif kind == NAME and not self.name:
            self.name = data

    def _add_message(self, status: int, data: bytes) -> None:
        """Add a message. A value beyond 127 is clipped; a key beyond it is none."""
        if max(data) > 0x7F:
            if status & 0xF0 in KEYED and data[0] > 0x7F:
                self._mended["a key beyond 127"] += 1
                return
            self._mended["a value beyond 127"] += 1
            data = bytes(min(byte, 0x7F) for byte in data)
        self.events.append(Event(self._now, self._make([status, *data]), None))


def describe_mended(mended: Counter[str]) -> str:
    """List what was wrong with a file, each with its number; "" if nothing was."""
    return ", ".join(f"{what} ({count})" for what, count in mended.items())
