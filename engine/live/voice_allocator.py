"""Notes are given to the voices of a player.

A note sounds the body of the patch whose pitch is nearest, with what contacts join to it, tuned to the note; its
velocity is the speed of the hammers, or the strength of the pluck; the pedal keeps the dampers away.
"""

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from engine.bodies import Body, Mass
from engine.bodies.distributed import DistributedBody
from engine.instrument.held_keys import HeldKeys
from engine.instrument.key_names import note_frequency, note_name
from engine.live.controls import Targets, targets_of_voice
from engine.live.midi_notes import MidiError, Move, Note
from engine.live.mpe import ChannelBends, NoteChannels
from engine.live.player import Player
from engine.live.voices import plucks, sounding_bodies, striker_velocities, strikers
from engine.patch.frames import nearest_frame
from engine.patch.scene import Scene, connected_bodies

NOMINAL_VELOCITY = 64  # velocity of a note at which hammers are as fast as the patch has them …
VELOCITY_EXPONENT = 1.5  # … and how their speed goes with it
PEDAL_DOWN = 64  # of 127; below, a pedal is up
RELEASE_DAMPER = 25.0, 0.5  # damper of a key let go: decay rate, 1/s, and how long, s
STEAL_DAMPER = 1500.0, 0.006  # damper of a voice that another note needs
AUDIBLE_ENERGY = 1e-8  # of the largest energy a voice has had: with more, it still sounds


class Key(NamedTuple):
    """A key that is pressed, or was."""

    number: int
    channels: NoteChannels  # that it follows

    def follows(self, move: Move, is_of_one_note: bool) -> bool:
        """True if a move of a controller, on a channel of one note or of one key, concerns this key."""
        mine = move.channel == self.channels.channel
        return (mine or not is_of_one_note) and (move.kind != "poly_pressure" or move.number == self.number)


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
    """Gives notes to the voices of a player."""

    def __init__(self, player: Player) -> None:
        self.player = player
        self.bodies = pitched_bodies(player.patch)
        self.played: dict[int, PitchedBody] = {}  # by key
        self.stolen = self.refused = 0
        self.ignored: dict[str, int] = {}  # messages, by what they are
        self._bends, self._held = ChannelBends(), HeldKeys[Key]()
        self._note: list[Key | None] = [None] * player.voices  # that a voice has
        self._since = [-1] * player.voices  # frame
        self._most = [0.0] * player.voices

    def play(self, note: Note, frame: int = 0) -> None:
        """Do what a note says, at a frame."""
        key = Key(note.number, note.channels)
        if note.kind == "bend":
            self._bend_pitch(note.channels.channel, note.value, frame)
        elif note.kind == "soft":
            self.ignored["soft pedal"] = self.ignored.get("soft pedal", 0) + 1
        elif note.kind in self._held.pedals:
            if self._held.move_pedal(note.kind, float(note.value >= PEDAL_DOWN)):
                for other in [one for one in self._note if one is not None]:
                    self._release(other, frame)
        elif note.kind == "off":
            self._held.down.discard(key)
            self._release(key, frame)
        else:
            self._strike(note, key, frame)

    def release_all(self, part: int, frame: int = 0) -> None:
        """Let go of all keys; voices do not know by which part they are held."""
        for key in list(self._held.down):
            self._held.down.discard(key)
            self._release(key, frame)

    def silence(self, frame: int = 0) -> None:
        """End all notes soon, whatever holds them."""
        self._held.down.clear()
        for voice, key in enumerate(self._note):
            if key is not None:
                self._damp(voice, STEAL_DAMPER, frame)

    def targets(self, move: Move, is_of_one_note: bool) -> Targets | None:
        """Return the live parameters that a move of a controller changes if it concerns some notes alone: the copies in
        their voices."""
        if not is_of_one_note and move.kind != "poly_pressure":
            return None
        voices = [n for n, key in enumerate(self._note) if key is not None and key.follows(move, is_of_one_note)]
        return lambda player, path: [one for n in voices for one in targets_of_voice(player, path, n)]

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
        voice, body = self._voice(key), nearest_body(self.bodies, note.number)
        frame = max(frame, self.player.frame)
        if self._note[voice] != key:
            if self._energy(voice) > AUDIBLE_ENERGY * self._most[voice] > 0.0:
                self.stolen += self._note[voice] in self._held.down
                begin = max(self.player.frame, frame - self._samples(STEAL_DAMPER))
                frame = begin + self._samples(STEAL_DAMPER)
                self._damp(voice, STEAL_DAMPER, begin)
            if not self._tune(voice, key, body, frame):
                return
        self._note[voice], self._since[voice] = key, frame
        self._held.down.add(key)
        self.played[note.number] = body
        share = (note.value / NOMINAL_VELOCITY) ** VELOCITY_EXPONENT
        for hammer in body.hammers:
            self.player.strike(f"{hammer}_{voice}", striker_velocities(self.player.patch)[hammer] * share, frame=frame)
        if body.plucked:
            self.player.pluck(f"{body.body}_{voice}", share, frame)

    def _release(self, key: Key, frame: int) -> None:
        """Damp the voice of a key, unless the key is down or a pedal keeps its damper lifted."""
        if key in self._note and self._held.damper_share(key) > 0.0:
            self._damp(self._note.index(key), RELEASE_DAMPER, frame)

    def _bend_pitch(self, channel: int, cents: float, frame: int) -> None:
        """Tune all voices with a note that follows a channel. A pitch beyond what they can have is refused, and they
        stay as they are."""
        self._bends.move(channel, cents)
        for voice, key in enumerate(self._note):
            if key is not None and channel in key.channels:
                self._tune(voice, key, self.played[key.number], frame)

    def _tune(self, voice: int, key: Key, body: PitchedBody, frame: int) -> bool:
        """Give a voice the pitch of a key. Return False if it cannot have that: it is above what the sample rate
        carries, or below what there is room for."""
        try:
            ratio = body.ratio(key.number) * self._bends.ratio(key.channels)
            self.player.tune(voice, ratio, frame, body=body.body)
        except ValueError:
            self.refused += 1
            return False
        return True

    def _voice(self, key: Key) -> int:
        """The voice for a note: the one that has it; else of those whose keys are up, or of all, the quieter ones among
        the older."""
        if key in self._note:
            return self._note.index(key)
        voices = range(self.player.voices)
        free = [v for v in voices if self._note[v] not in self._held.down] or list(voices)
        older = sorted(free, key=lambda v: self._since[v])[: (len(free) + 1) // 2]
        return min(older, key=lambda v: (self._energy(v), self._since[v]))

    def _energy(self, voice: int) -> float:
        """Kinetic energy of what a voice lets be heard, about, J."""
        mode = self.player.model.islands.mode
        islands = (mode.size - 1) // self.player.voices
        modes = slice(mode[voice * islands], mode[(voice + 1) * islands])
        heard = np.abs(self._ears[modes]) > 0.0
        energy = float(np.sum(self.player.state.p[modes][heard] ** 2))
        self._most[voice] = max(self._most[voice], energy)
        return energy

    @cached_property
    def _ears(self) -> np.ndarray:
        """Weights of the modes [modes]: 1 for modes of bodies with a pickup, 0 for others."""
        layout, weights = self.player.layout, np.zeros(self.player.state.p.size)
        for pickup in self.player.scene.pickup:
            weights[layout.modes.of_body[layout.body_index[pickup.body]]] = 1.0
        return weights

    def _samples(self, damper: tuple[float, float]) -> int:
        return nearest_frame(damper[1], self.player.samplerate)

    def _damp(self, voice: int, damper: tuple[float, float], frame: int) -> None:
        for name in sounding_bodies(self.player.patch):
            self.player.damp(f"{name}_{voice}", *damper, frame=frame)
