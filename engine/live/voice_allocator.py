"""Notes are given to the voices of a player.

A note sounds the body of the patch whose pitch is nearest, with what contacts join to it, tuned to the note; its
velocity is the speed of the hammers, or the strength of the pluck; the pedal keeps the dampers away.
"""

import math
import threading
from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from engine.bodies import Body, Mass
from engine.bodies.distributed import DistributedBody
from engine.instrument.held_keys import ALL, PEDAL_NAMES, HeldKeys
from engine.instrument.key_names import note_frequency, note_name
from engine.live.controls import Controls, Targets, targets_of_voice
from engine.live.midi_drivers import MidiError
from engine.live.midi_notes import PEDAL_DOWN, Move, Note
from engine.live.mpe import ChannelBends, NoteChannels
from engine.live.player import Player
from engine.live.voices import plucks, sounding_bodies, striker_velocities, strikers
from engine.patch.frames import nearest_frame
from engine.patch.scene import Scene, connected_bodies

NOMINAL_VELOCITY = 64  # velocity of a note at which hammers are as fast as the patch has them …
VELOCITY_EXPONENT = 1.5  # … and how their speed goes with it
RELEASE_DAMPER = 25.0, 0.5  # damper of a key let go: decay rate, 1/s, and how long, s
STEAL_DAMPER = 1500.0, 0.006  # damper of a voice that another note needs
NEVER = 1 << 60  # a frame


class Key(NamedTuple):
    """A key that is pressed, or was."""

    number: int
    channels: NoteChannels  # that it follows

    def follows(self, move: Move, is_together: bool) -> bool:
        """True if a move of a controller concerns this key. is_together: outside zones, those of all channels do"""
        mine = move.channel in self.channels.followed() or self.channels.channel == ALL
        mine = mine or (is_together and self.channels.master == ALL)
        return mine and (move.kind != "poly_pressure" or move.number == self.number)


@dataclass
class Voice:
    """The note of a voice. All of it follows from the messages and their frames."""

    key: Key | None = None  # that it has, or had
    since: int = -1  # frame at which it was pressed
    delay: int = 0  # frames by which the note began later, as another one had to end
    quiet: int = 0  # frame from which it is silent; NEVER while it sounds
    ratio: float = 0.0  # to which it is tuned, of its body


class PitchedBody(NamedTuple):
    """A body that notes can sound."""

    body: str
    frequency: float  # of its lowest mode, Hz
    hammers: list[str]  # that are thrown at it
    plucked: bool

    def ratio(self, note: int) -> float:
        """Of the frequency of a note to its own."""
        return note_frequency(note) / self.frequency


def pitched_bodies(scene: Scene) -> list[PitchedBody]:
    """The bodies that notes can sound: those that vibrate, are struck or plucked, and sound or touch a body that
    is. Raises MidiError if there are none."""
    heard, bodies = {p.body for p in scene.pickup}, []
    hammers = striker_velocities(scene)
    for body in scene.body:
        name = body.name
        if isinstance(body, Mass) or name in hammers or not connected_bodies(scene, name) & heard:
            continue
        lowest = lowest_partial(body)
        struck, plucked = strikers(scene, name), bool(plucks(scene, name))
        if lowest > 0.0 and (struck or plucked):
            bodies.append(PitchedBody(name, lowest / (2 * math.pi), struck, plucked))
    if not bodies:
        first = scene.pickup[0].body
        if next(b for b in scene.body if b.name == first).kind == "mass":
            raise MidiError(f"{first} has no pitch to tune; notes need a vibrating body")
        raise MidiError("no vibrating body is struck or plucked; notes need a hammer with a velocity, or a pluck")
    return bodies


def lowest_partial(body: Body) -> float:
    """Angular frequency of the first partial of a body, rad/s; 0 without one. What a free bar or plate does as a whole
    is none."""
    omega = body.modal_body(20_000.0).omega
    if omega.size == 0:
        return 0.0
    return float(omega[0] if isinstance(body, DistributedBody) else omega.min())


def nearest_body(bodies: list[PitchedBody], note: int) -> PitchedBody:
    """The body whose pitch is nearest to a note; of two alike, the first."""
    return min(bodies, key=lambda b: abs(math.log(b.ratio(note))))


class VoiceAllocator:
    """Gives notes to the voices of a player.

    bends_later: True if `poll` bends voices to where the wheel is by then, beside the notes: for a port, whose wheel
                 moves faster than tables are made; else each move bends them at its frame
    controls:    that notes begin with what their channels have moved; None if nothing does
    """

    bends_later = False
    controls: Controls | None = None

    def __init__(self, player: Player) -> None:
        self.player = player
        self.bodies = pitched_bodies(player.patch)
        self.played: dict[int, PitchedBody] = {}  # by key
        self.stolen = self.refused = 0
        self.ignored: dict[str, int] = {}  # messages, by what they are
        self._bends, self._held = ChannelBends(), HeldKeys[Key]()
        self._tuned = dict[int, float]()  # cents, of keys that messages have tuned
        self._holding: dict[Key, Counter[int]] = {}  # how often each part has pressed a key that it holds
        self._voices = [Voice() for _ in range(player.voices)]
        self._tuning = threading.RLock()  # voices are tuned one at a time: a note waits for one at most

    def take_over(self, other: object) -> None:
        """Go on from where another one was: pedals and wheels stay as they are, and what was counted counts. One of
        another kind leaves nothing."""
        if not isinstance(other, VoiceAllocator):
            return
        self._bends, self.bends_later, self._tuned = other._bends, other.bends_later, other._tuned
        self.together = other.together
        for move in other._held.pedal_moves():
            self._held.move_pedal(*move)
        self.played |= other.played
        self.stolen, self.refused = self.stolen + other.stolen, self.refused + other.refused
        self.ignored |= other.ignored

    def play(self, note: Note, frame: int = 0) -> None:
        """Do what a note says, at a frame."""
        key, frame = Key(note.number, note.channels), max(frame, self.player.frame)
        if note.kind == "bend":
            self._bends.move(note.channels, note.value)
            self._bend(frame)
        elif note.kind == "tune":
            self._tuned[note.number] = note.value
            self._bend(frame)
        elif note.kind in ("program", "soft"):
            kind = {"program": "program change", "soft": "soft pedal"}[note.kind]
            self.ignored[kind] = self.ignored.get(kind, 0) + 1
        elif note.kind in PEDAL_NAMES:
            channel = note.channels.channel
            if self._held.move_pedal(note.kind, float(note.value >= PEDAL_DOWN), channel):
                for voice in self._used_on(channel):
                    self._release(voice, frame)
        elif note.kind == "silence":
            self._silence(note.channels.channel, frame)
        elif note.kind == "off":
            self._let_go(key, note.part, frame)
        else:
            self._strike(note, key, frame)

    def release_all(self, part: int, frame: int = 0) -> None:
        """Let go of all keys that a part, or a channel, holds."""
        for key, holding in list(self._holding.items()):
            if holding[part]:
                holding[part] = 1
                self._let_go(key, part, max(frame, self.player.frame))

    def _let_go(self, key: Key, part: int, frame: int) -> None:
        """Let a part go of a key, which sounds until no part holds it, and each has let go of it as often as it has
        pressed it."""
        holding = self._holding.get(key, Counter[int]())
        holding[part] = max(0, holding[part] - 1)
        if holding.total():
            return
        self._holding.pop(key, None)
        self._held.down.discard(key)
        for voice in self._used():
            if self._voices[voice].key == key:
                self._release(voice, frame)

    def _silence(self, channel: int, frame: int) -> None:
        """End all notes of a channel soon, whatever holds them."""
        for number in self._used_on(channel):
            key = self._voices[number].key
            if key is not None:
                self._held.down.discard(key)
                self._holding.pop(key, None)
            self._damp(number, STEAL_DAMPER, frame)
            self._voices[number].quiet = frame + self._samples(STEAL_DAMPER)

    def _used_on(self, channel: int) -> list[int]:
        """Return the voices whose notes follow a channel."""
        keys = [(number, self._voices[number].key) for number in self._used()]
        return [number for number, key in keys if key is not None and self._held.follows(key, channel)]

    @property
    def together(self) -> bool:
        """True if wheels and pedals act on the notes of all channels."""
        return self._held.together

    @together.setter
    def together(self, together: bool) -> None:
        self._held.together = self._bends.together = together

    def _used(self) -> list[int]:
        """Return the voices that have had a note."""
        return [n for n, voice in enumerate(self._voices) if voice.key is not None]

    def targets(self, move: Move, is_of_one_note: bool) -> Targets | None:
        """Return the live parameters that a move of a controller changes if it concerns some notes alone: the copies in
        the voices of its channel. Voices that have had no note follow all channels, but no single note."""
        is_together = self.together and not is_of_one_note
        is_of_all = not is_of_one_note and move.kind != "poly_pressure"
        keys = [voice.key for voice in self._voices]
        voices = [n for n, key in enumerate(keys) if (is_of_all if key is None else key.follows(move, is_together))]
        if is_of_all and len(voices) == len(keys):
            return None
        return lambda player, path: [one for n in voices for one in targets_of_voice(player, path, n)]

    def _begin_controls(self, number: int, key: Key, frame: int) -> None:
        """Let the note of a voice begin with what the controllers of its channels say."""
        is_of_all = key.channels.channel == ALL or (self.together and key.channels.master == ALL)
        if self.controls is not None and not is_of_all:
            targets = partial(targets_of_voice, voice=number)
            self.controls.begin_note(targets, key.channels.followed(), key.number, frame)

    def played_notes(self) -> dict[str, str]:
        """List the notes that each body has played, by name, with their distance from its pitch if they are in its own
        octave."""
        names: dict[str, list[str]] = {}
        for number, body in sorted(self.played.items()):
            cents = 1200 * math.log2(body.ratio(number))
            away = f" ({cents:+.0f} c)" if abs(cents) >= 0.5 else ""
            names.setdefault(body.body, []).append(note_name(number) + away)
        return {body: ", ".join(notes) for body, notes in names.items()}

    def _strike(self, note: Note, key: Key, frame: int) -> None:
        number, body, delay = self._find_voice(key), nearest_body(self.bodies, note.number), 0
        voice = self._voices[number]
        ratio = self._ratio(key, body)
        if voice.key != key or voice.ratio != ratio:
            if voice.key != key and voice.quiet > frame:
                self.stolen += voice.key in self._held.down
                delay = self._samples(STEAL_DAMPER)
                self._damp(number, STEAL_DAMPER, frame)
            with self._tuning:
                if not self._tune(number, ratio, body, frame + delay):
                    return
                voice = self._voices[number] = Voice(key, frame, delay, NEVER, ratio)
        voice.key, voice.since, voice.delay, voice.quiet = key, frame, delay, NEVER
        self._begin_controls(number, key, frame + delay)
        self._held.press(key, key.channels.followed())
        self._holding.setdefault(key, Counter())[note.part] += 1
        self.played[note.number] = body
        share = (note.value / NOMINAL_VELOCITY) ** VELOCITY_EXPONENT
        for hammer in body.hammers:
            speed = striker_velocities(self.player.patch)[hammer] * share
            self.player.strike(f"{hammer}_{number}", speed, frame=frame + delay)
        if body.plucked:
            self.player.pluck(f"{body.body}_{number}", share, frame + delay)

    def _release(self, number: int, frame: int) -> None:
        """Damp a voice, unless its key is down or a pedal keeps its damper lifted. A note that began late ends late."""
        voice = self._voices[number]
        if voice.key is not None and self._held.damper_share(voice.key) > 0.0:
            frame += voice.delay
            self._damp(number, RELEASE_DAMPER, frame)
            voice.quiet = min(voice.quiet, frame + self._samples(RELEASE_DAMPER))

    def _bend(self, frame: int) -> None:
        """Bend the voices as far as wheels and tunings say, or let `poll` do so."""
        if not self.bends_later:
            self._follow_bends(frame)

    def poll(self) -> None:
        """Bend the voices as far as the wheel says by now. The tables for that take a while: call it beside `play`."""
        if self.bends_later:
            self._follow_bends(self.player.frame)

    def _follow_bends(self, frame: int) -> None:
        """Tune the voices that sound and whose pitch is another now. A pitch beyond what a voice can have is refused,
        and it stays as it is."""
        for number in self._used():
            with self._tuning:
                voice = self._voices[number]
                if voice.key is not None and voice.quiet > frame:
                    body = self.played[voice.key.number]
                    ratio = self._ratio(voice.key, body)
                    if ratio != voice.ratio:
                        self._tune(number, ratio, body, frame + voice.delay)
                        voice.ratio = ratio

    def _ratio(self, key: Key, body: PitchedBody) -> float:
        """Return the ratio of the pitch of a key, bent as it is now, to that of a body."""
        tuned = float(2.0 ** (self._tuned.get(key.number, 0.0) / 1200.0))
        return body.ratio(key.number) * self._bends.ratio(key.channels) * tuned

    def _tune(self, voice: int, ratio: float, body: PitchedBody, frame: int) -> bool:
        """Give a voice a pitch. Return False if it cannot have that: it is above what the sample rate carries, or below
        what there is room for."""
        try:
            self.player.tune(voice, ratio, frame, body=body.body)
        except ValueError:
            self.refused += 1
            return False
        return True

    def _find_voice(self, key: Key) -> int:
        """Return the voice for a note: the one that has it; else the oldest of those whose keys are up, or of all."""
        voices = range(len(self._voices))
        mine = next((n for n in voices if self._voices[n].key == key), None)
        if mine is not None:
            return mine
        free = [n for n in voices if self._voices[n].key not in self._held.down] or list(voices)
        return min(free, key=lambda n: self._voices[n].since)

    def _samples(self, damper: tuple[float, float]) -> int:
        return nearest_frame(damper[1], self.player.samplerate)

    def _damp(self, voice: int, damper: tuple[float, float], frame: int) -> None:
        for name in sounding_bodies(self.player.patch):
            self.player.damp(f"{name}_{voice}", *damper, frame=frame)
