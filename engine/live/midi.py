"""MIDI: notes from a file or a port, played by the voices of a scene.

A note sounds the body of the patch whose pitch is nearest, with what contacts join to it, tuned to the note; its
velocity is the speed of the hammers, or the strength of the pluck; the pedal keeps the dampers away. mido is imported
when asked for.
"""

import io
import math
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from engine.bodies import Mass
from engine.files import UnreadableFile, read_bytes
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.live.voices import plucks, striker_velocities, strikers
from engine.output_files import error_reason
from engine.patch.scene import Scene, connected_bodies
from engine.patch.tables import MAX_SECONDS

LEAD = 0.05  # s before the first note of a file that is played live: what comes first fades in
TAIL = 3.0  # s after the last
AHEAD = 0.2  # s, by which notes of a file are told before they sound
ORDINARY = 64  # velocity of a note at which hammers are as fast as the patch has them …
STEEPER = 1.5  # … and how their speed goes with it
OFF = 25.0, 0.5  # damper of a key let go: decay rate, 1/s, and how long, s
STOLEN = 1500.0, 0.006  # damper of a voice that another note needs
PEDAL = 64  # controller
QUIET = 1e-6  # gain of a render: single precision is as exact at any, and no limiter is to act
LARGEST, MESSAGES = 16_000_000, 1_000_000  # bytes of a file, and how many messages it has at most
LONGEST = 36_000.0  # s
ALIVE = 1e-8  # of the largest energy a voice has had: with more, it still sounds


Source = Callable[[], bool]  # tells what has to be told, and whether all is over


class MidiError(RuntimeError):
    """What stands against playing notes, and what would be right."""


class Sounding(NamedTuple):
    """A body that notes can sound."""

    body: str
    frequency: float  # of its lowest mode, Hz
    hammers: list[str]  # that are striker_velocities at it
    plucked: bool

    def ratio(self, note: int) -> float:
        """Of the frequency of a note to its own."""
        return frequency(note) / self.frequency


class Note(NamedTuple):
    """A message."""

    seconds: float
    kind: str  # on | off | pedal
    number: int  # of the key
    value: int  # velocity, or how far the pedal is down


def library() -> Any:
    """The module mido. Raises MidiError."""
    try:
        import mido
    except ImportError:
        raise MidiError("notes need mido; uv sync --extra midi, or pip install mido python-rtmidi") from None
    return mido


def note_of(message: Any, seconds: float) -> Note | None:
    """A message as a Note, if it is one."""
    if message.type == "note_on" and message.velocity > 0:
        return Note(seconds, "on", message.note, message.velocity)
    if message.type in ("note_on", "note_off"):
        return Note(seconds, "off", message.note, 0)
    if message.type == "control_change" and message.control == PEDAL:
        return Note(seconds, "pedal", 0, message.value)
    return None


def notes_of(path: Path) -> list[Note]:
    """The notes of a .mid file, all tracks together; the file begins at 0. Raises MidiError."""
    file, found, seconds = opened(path), [], 0.0
    try:
        for message in file:
            seconds += message.time
            if note := note_of(message, seconds):
                found.append(note)
    except Exception as error:  # whatever mido stumbles over
        raise unreadable(path, error) from error
    if not 0.0 <= seconds <= LONGEST:
        raise MidiError(f"{path} lasts {seconds / 3600:.3g} hours; at most {LONGEST / 3600:g}")
    if not any(note.kind == "on" for note in found):
        raise MidiError(f"{path} has no notes")
    return found


def opened(path: Path) -> Any:
    """A .mid file as mido has it. Raises MidiError if it is none, or none that could be played."""
    mido = library()
    try:
        file = mido.MidiFile(file=io.BytesIO(read_bytes(path, LARGEST)))
    except UnreadableFile as error:
        raise MidiError(f"{path} {error}; give a .mid file") from error
    except Exception as error:
        raise unreadable(path, error) from error
    if file.type not in (0, 1):
        raise MidiError(f"{path} is of type {file.type}, whose tracks are pieces of their own; save it as type 0 or 1")
    if file.ticks_per_beat <= 0:
        how = "counts frames of film (SMPTE)" if file.ticks_per_beat < 0 else "has 0 ticks a beat"
        raise MidiError(f"{path} {how}; save it with ticks per beat, such as 480")
    if (count := sum(map(len, file.tracks))) > MESSAGES:
        raise MidiError(f"{path} has {count} messages; at most {MESSAGES}")
    return file


def unreadable(path: Path, error: Exception) -> MidiError:
    """That a file is no MIDI, in a line."""
    why = " ".join(error_reason(error).split()) or type(error).__name__
    return MidiError(f"{path} cannot be read as MIDI ({why[:200]})")


def port(name: str) -> Any:
    """An open input port of a name, or of a part of it. Raises MidiError."""
    mido = library()
    try:
        names = mido.get_input_names()
    except (ImportError, OSError) as error:
        raise MidiError(f"no MIDI ports ({error}); uv sync --extra midi, or give a .mid file") from error
    chosen = [n for n in names if name.lower() in n.lower()]
    if len(chosen) != 1:
        what = "several MIDI ports match" if chosen else "no MIDI port is called"
        raise MidiError(f'{what} "{name}"; there are {", ".join(names) or "none"}; or give a .mid file')
    return mido.open_input(chosen[0])


def sounding(scene: Scene) -> list[Sounding]:
    """The bodies that notes can sound: those that vibrate, are struck or plucked, and are heard or in contact with what
    is. Raises MidiError if there are none."""
    heard, found = {p.body for p in scene.pickup}, []
    hammers = striker_velocities(scene)
    for body in scene.body:
        name = body.name
        if isinstance(body, Mass) or name in hammers or not connected_bodies(scene, name) & heard:
            continue
        omega = body.modal_body(20_000.0).omega
        struck, plucked = strikers(scene, name), bool(plucks(scene, name))
        if omega.size and omega.min() > 0.0 and (struck or plucked):
            found.append(Sounding(name, float(omega.min()) / (2 * math.pi), struck, plucked))
    if not found:
        first = scene.pickup[0].body
        if next(b for b in scene.body if b.name == first).kind == "mass":
            raise MidiError(f"{first} has no pitch that could be tuned; notes need a body that vibrates")
        raise MidiError("nothing that vibrates is struck or plucked; notes need a striker_velocities hammer or a pluck")
    return found


def nearest(bodies: list[Sounding], note: int) -> Sounding:
    """The body whose pitch is nearest to a note; of two alike, the first."""
    return min(bodies, key=lambda b: abs(math.log(b.ratio(note))))


NAMES = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"]


def name_of(note: int) -> str:
    """Of a key, as 60 is C4."""
    return f"{NAMES[note % 12]}{note // 12 - 1}"


def frequency(note: int) -> float:
    """Equal temperament, A4 = 440 Hz."""
    return float(440.0 * 2.0 ** ((note - 69) / 12))


class Keys:
    """Gives notes to the voices of a player."""

    def __init__(self, player: Player) -> None:
        self.player = player
        self.bodies = sounding(player.patch)
        self.played: dict[int, Sounding] = {}  # by key
        self.stolen = self.refused = 0
        self._note: list[int | None] = [None] * player.voices  # that a voice has
        self._since = [-1] * player.voices  # frame
        self._down: set[int] = set()  # keys
        self._pedal = False
        self._most = [0.0] * player.voices

    def play(self, note: Note, frame: int = 0) -> None:
        """Do what a note says, at a frame."""
        if note.kind == "pedal":
            self._pedal = note.value >= 64
            if not self._pedal:
                for voice, number in enumerate(self._note):
                    if number is not None and number not in self._down:
                        self._damp(voice, OFF, frame)
        elif note.kind == "off":
            self._down.discard(note.number)
            if note.number in self._note and not self._pedal:
                self._damp(self._note.index(note.number), OFF, frame)
        else:
            self._strike(note, frame)

    def _strike(self, note: Note, frame: int) -> None:
        voice, body = self._voice(note.number), nearest(self.bodies, note.number)
        frame = max(frame, self.player.frame)
        if self._note[voice] != note.number:
            if self._energy(voice) > ALIVE * self._most[voice] > 0.0:
                self.stolen += self._note[voice] in self._down
                begin = max(self.player.frame, frame - self._samples(STOLEN))
                frame = begin + self._samples(STOLEN)
                self._damp(voice, STOLEN, begin)
            try:
                self.player.tune(voice, body.ratio(note.number), frame, body=body.body)
            except ValueError:  # above what the sample rate carries, or below what there is room for
                self.refused += 1
                return
        self._note[voice], self._since[voice] = note.number, frame
        self._down.add(note.number)
        self.played[note.number] = body
        share = (note.value / ORDINARY) ** STEEPER
        for hammer in body.hammers:
            self.player.strike(f"{hammer}_{voice}", striker_velocities(self.player.patch)[hammer] * share, frame=frame)
        if body.plucked:
            self.player.pluck(f"{body.body}_{voice}", share, frame)

    def _voice(self, number: int) -> int:
        """The voice for a note: the one that has it; else of those whose keys are up, or of all, the quieter ones among
        the older."""
        if number in self._note:
            return self._note.index(number)
        voices = range(self.player.voices)
        free = [v for v in voices if self._note[v] not in self._down] or list(voices)
        older = sorted(free, key=lambda v: self._since[v])[: (len(free) + 1) // 2]
        return min(older, key=lambda v: (self._energy(v), self._since[v]))

    def _energy(self, voice: int) -> float:
        """Kinetic energy of what a voice lets be heard, about, J."""
        mode = self.player.model.islands.mode
        islands = (mode.size - 1) // self.player.voices
        own = slice(mode[voice * islands], mode[(voice + 1) * islands])
        heard = np.abs(self._ears[own]) > 0.0
        found = float(np.sum(self.player.state.p[own][heard] ** 2))
        self._most[voice] = max(self._most[voice], found)
        return found

    @cached_property
    def _ears(self) -> np.ndarray:
        """Which modes belong to bodies that are heard."""
        layout, found = self.player.layout, np.zeros(self.player.state.p.size)
        for pickup in self.player.scene.pickup:
            found[layout.global_modes(layout.body_index[pickup.body])] = 1.0
        return found

    def _samples(self, damper: tuple[float, float]) -> int:
        return round(damper[1] * self.player.samplerate)

    def _damp(self, voice: int, damper: tuple[float, float], frame: int) -> None:
        for name in dict.fromkeys(p.body for p in self.player.patch.pickup):
            self.player.damp(f"{name}_{voice}", *damper, frame=frame)


class File:
    """The notes of a file, told to keys as their time comes near."""

    def __init__(self, keys: Keys, notes: list[Note], lead: float = 0.0) -> None:
        self.keys, self._next = keys, 0
        self.notes = [note._replace(seconds=note.seconds + lead) for note in notes]

    @property
    def end(self) -> float:
        """When all has died away, s."""
        return self.notes[-1].seconds + TAIL

    def look(self) -> bool:
        """Tell the notes of the next moments; returns whether all is over."""
        rate, now = self.keys.player.samplerate, self.keys.player.frame
        while self._next < len(self.notes) and self.notes[self._next].seconds * rate < now + AHEAD * rate:
            note = self.notes[self._next]
            self.keys.play(note, round(note.seconds * rate))
            self._next += 1
        return now > self.end * rate


def source(text: str, keys: Keys) -> Source:
    """What has to be called often for the notes of a file or a port to be played. Raises MidiError."""
    if Path(text).suffix.lower() in (".mid", ".midi"):
        return File(keys, notes_of(Path(text)), LEAD).look
    opened = port(text)

    def look() -> bool:
        for message in opened.iter_pending():
            if note := note_of(message, 0.0):
                keys.play(note)
        return False

    return look


def lowest(text: str, scene: Scene) -> float:
    """Ratio of the lowest pitch that will be played: that of a file's lowest note; for a port, two octaves down."""
    if Path(text).suffix.lower() in (".mid", ".midi"):
        bodies = sounding(scene)
        notes = {note.number for note in notes_of(Path(text)) if note.kind == "on"}
        return min(1.0, *(nearest(bodies, note).ratio(note) for note in notes))
    return 0.25


def render(
    scene: Scene, text: str, samplerate: int, seconds: float | None, voices: int, progress: Any = None
) -> tuple[np.ndarray, Player, dict[str, str]]:
    """What the notes of a file sound like, in SI units [frames, channels]; the player, for what it can tell; and which
    body played which notes. Raises MidiError."""
    notes = notes_of(Path(text))
    player = Player(scene, samplerate, math.inf, QUIET, voices, lowest(text, scene))
    player.shared[Slot.FADE_IN_FRAMES] = 0  # a file begins with its first note
    keys = Keys(player)
    told = File(keys, notes)
    if seconds is None and told.end > MAX_SECONDS:
        raise MidiError(
            f"{text} lasts {told.end:.0f} s; at most {MAX_SECONDS:g}, such as --seconds {MAX_SECONDS:g} of it"
        )
    frames = round((seconds or told.end) * samplerate)
    out, block = np.zeros((frames, player.channels), np.float32), round(AHEAD * samplerate / 2)
    for begin in range(0, frames, block):
        told.look()
        player.render_into(out[begin : begin + block])
        if progress is not None:
            progress(min(1.0, (begin + block) / frames))
    return out / QUIET, player, told_of(keys)


def told_of(keys: Keys) -> dict[str, str]:
    """Which notes each body has played: those in its own octave by name, with how far they are from its pitch."""
    found: dict[str, list[str]] = {}
    for number, body in sorted(keys.played.items()):
        cents = 1200 * math.log2(body.ratio(number))
        found.setdefault(body.body, []).append(name_of(number) + (f" ({cents:+.0f} c)" if abs(cents) >= 0.5 else ""))
    return {body: ", ".join(notes) for body, notes in found.items()}
