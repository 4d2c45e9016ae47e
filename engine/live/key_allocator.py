"""The keys of an instrument, played live: strikes, plucks, dampers and pedals of the bodies that each key has."""

from collections import Counter, defaultdict
from typing import Any

from engine.instrument.expansion import expand_keys, keys_of
from engine.instrument.held_keys import HeldKeys
from engine.instrument.key_names import note_name, plain_note_name
from engine.instrument.key_writer import KeyWriter
from engine.instrument.score import Score
from engine.instrument.score_events import FULL_VELOCITY, events_of_key, waiting_forces
from engine.live.controls import Targets, targets_of_all
from engine.live.key_bends import KeyBends, bent_parameters
from engine.live.midi_notes import UNKNOWN_RELEASE, Move, Note
from engine.live.player import Player
from engine.patch.frames import nearest_frame
from engine.patch.friction import CHANGED_KEYS as FRICTION_KEYS
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS, LastingForce

DAMPER_SECONDS = MAX_SECONDS  # how long a damper stays down if nothing lifts it
STEAL_DAMPER = 300.0, 0.03  # of a key that another needs: decay rate, 1/s, and how long, s
CHANGES = ("stiffness", "exponent", "barrier", "gap", "damping_coefficient", "rest")  # what an event may change
CHANGES_OF = {"contact": CHANGES, "connection": CHANGES, "friction": FRICTION_KEYS}
CHANGE_SECONDS = 0.005  # that a change glides
DEFAULT_POLYPHONY = 24


def live_scene(scene: Scene, keys: list[int] | None = None) -> Scene:
    """An instrument with some keys, or all, at rest with its dampers down, to be played. Raises ValueError if it is
    none, PatchError if the patch has an error at one of them."""
    document = scene.instrument
    if document is None:
        raise ValueError("the patch is not an instrument; an instrument has a [keyboard]")
    chosen = keys_of(document["keyboard"]) if keys is None else keys
    played = scene.with_expansion(expand_keys(document, chosen, Score(), is_live=True))
    return played.model_copy(update={"accuracy": scene.accuracy})


class KeyAllocator:
    """Plays the keys of an instrument. player: of a `live_scene`, with `waiting = True`."""

    def __init__(self, player: Player) -> None:
        document = player.patch.instrument
        if document is None:
            raise ValueError("the patch is not an instrument; an instrument has a [keyboard]")
        self.player, self._writer = player, KeyWriter(document)
        self.stolen = self.refused = 0
        self.ignored: dict[str, int] = {}  # messages, by what they are
        self.polyphony = document["keyboard"].get("polyphony") or DEFAULT_POLYPHONY
        self._mono = document["keyboard"].get("mono")
        self.keys = [key for key in keys_of(document["keyboard"]) if self._has_bodies(key)]
        for key in self.keys:
            self._writer.write_key(key)
        self._places = self._places_of_forces()
        self._held = HeldKeys[int]()
        self._holding: dict[int, set[int]] = {}  # parts of a file, or channels, that hold a key
        self._sounding: list[int] = []  # keys whose notes the dampers have not ended, the oldest first
        self._played: dict[int, int] = {}
        self._on_channel: dict[int, int] = {}  # of an MPE zone: the key pressed last
        bodies = [body.model_dump(exclude_unset=True) for body in player.scene.body]
        bent = [one for one in bent_parameters(bodies, self.keys) if one.path in player.live_paths]
        self._bends, self._bent = KeyBends(bent), {one.path: one.value for one in bent}

    def played_notes(self) -> dict[str, str]:
        """Count the notes of each key that was played."""
        return {note_name(key): f"{count} times" for key, count in sorted(self._played.items())}

    def play(self, note: Note, frame: int = 0) -> None:
        """Do what a message says, at a frame."""
        self._bends.follow(note)
        if note.kind == "bend":
            if not self._bent:
                self.ignored["pitch bend"] = self.ignored.get("pitch bend", 0) + 1
        elif note.kind in self._held.pedals:
            self._move_pedal(note.kind, note.value / FULL_VELOCITY, frame)
        elif note.kind == "off":
            holding = self._holding.get(note.number, set())
            holding.discard(note.part)
            if not holding:
                self._release(note.number, note.value / FULL_VELOCITY, frame)
        elif note.number not in self.keys:
            self.refused += 1
        else:
            self._on_channel[note.channels.channel] = note.number
            self._holding.setdefault(note.number, set()).add(note.part)
            self._press(note.number, note.value / FULL_VELOCITY, frame)

    def release_all(self, part: int, frame: int = 0) -> None:
        """Let go of all keys that a part, or a channel, holds."""
        for key in [key for key, holding in self._holding.items() if part in holding]:
            self.play(Note(0.0, "off", key, UNKNOWN_RELEASE, part=part), frame)

    def silence(self, frame: int = 0) -> None:
        """End all notes soon, whatever holds them."""
        for key in list(self._sounding):
            self.end(key, frame)

    def poll(self) -> None:
        """Bend the keys as far as the wheel says by now. The tables for that take a while: call it beside `play`."""
        values = self._bends.values()
        changed = {path: value for path, value in values.items() if value != self._bent[path]}
        if changed:
            self._bent = values
            try:
                self.player.set(changed, seconds=0.0)
            except ValueError:  # beyond what the sample rate carries
                self.refused += 1

    def targets(self, move: Move, is_of_one_note: bool) -> Targets | None:
        """Return the live parameters that a move of a controller changes if it concerns some notes alone: those of
        their keys."""
        if not is_of_one_note and move.kind != "poly_pressure":
            return None
        key = move.number if move.kind == "poly_pressure" else self._on_channel.get(move.channel)
        name = None if key is None else plain_note_name(key)
        return lambda player, path: [
            one
            for one in targets_of_all(player, path)
            if one.split(".")[1:2] and one.split(".")[1].startswith(f"{name}_")
        ]

    # --- keys

    def _has_bodies(self, key: int) -> bool:
        """True if the scene was written out with a key."""
        return any(body.startswith(f"{plain_note_name(key)}_") for body in self.player.layout.body_index)

    def _places_of_forces(self) -> dict[tuple[int, str], list[int]]:
        """Places of a key's forces among those of a body, by key and body: keys may pluck one that they share."""
        brief = [f.body for f in self.player.scene.force if f.amplitude != 0.0 and not isinstance(f, LastingForce)]
        waiting = [(key, force) for key in self.keys for force, _, _ in waiting_forces(self._writer, key)]
        of_keys = [(key, force["body"]) for key, force in waiting if force["amplitude"] != 0.0]
        next_place = Counter(brief) - Counter(body for _, body in of_keys)  # those of the patch itself come first
        places = defaultdict[tuple[int, str], list[int]](list)
        for key, body in of_keys:
            places[key, body].append(next_place[body])
            next_place[body] += 1
        return places

    def _press(self, key: int, v: float, frame: int) -> None:
        self._make_room(key, frame)
        self._held.down.add(key)
        self._sounding = [*(k for k in self._sounding if k != key), key]
        self._played[key] = self._played.get(key, 0) + 1
        self.lift(key, frame)
        names = {"v": v, "soft": self._held.pedals["soft"], "release": 0.5}
        for event, _, _ in events_of_key(self._writer, "on", key, names, 0.0):
            self._do(event, key, frame)

    def _release(self, key: int, release: float, frame: int) -> None:
        if key not in self._held.down:
            return
        self._let_go(key, release, frame)
        self.damp(key, release, frame)

    def _let_go(self, key: int, release: float, frame: int) -> None:
        """Do what a key does when it is let go, but for its dampers."""
        self._held.down.discard(key)
        names = {"v": 0.5, "soft": self._held.pedals["soft"], "release": release}
        for event, _, _ in events_of_key(self._writer, "off", key, names, 0.0):
            self._do(event, key, frame)

    def _make_room(self, key: int, frame: int) -> None:
        """End the notes that cannot go on beside a new one: of its group, or one too many."""
        if self._mono is not None:
            group = self._writer.names(key).get(self._mono)
            for other in [k for k in self._sounding if self._writer.names(k).get(self._mono) == group and k != key]:
                self.end(other, frame)
        others = [k for k in self._sounding if k != key]
        while len(others) >= self.polyphony:
            oldest = next((k for k in others if k not in self._held.down), others[0])
            self.stolen += 1
            self.end(oldest, frame)
            others.remove(oldest)

    def end(self, key: int, frame: int) -> None:
        """End a note soon, whatever the pedals say: a bow is lifted, and dampers come down."""
        release = UNKNOWN_RELEASE / FULL_VELOCITY
        if key in self._held.down:
            self._let_go(key, release, frame)
        self._held.kept.discard(key)
        self._holding.pop(key, None)
        self._sounding = [k for k in self._sounding if k != key]
        for event in self._damper_events(key, release):
            self.player.damp(event["body"], *STEAL_DAMPER, frame=frame)
        self.damp(key, release, frame)

    # --- dampers and pedals

    def _damper_events(self, key: int, release: float) -> list[dict[str, Any]]:
        names = {"release": release, "v": 0.0, "soft": 0.0}
        return [event for event, _, _ in events_of_key(self._writer, "damper", key, names, 0.0)]

    def lift(self, key: int, frame: int) -> None:
        for event in self._damper_events(key, 0.5):
            self.player.lift(event["body"], frame)

    def damp(self, key: int, release: float, frame: int) -> None:
        """Put the dampers of a key down as far as the pedals let them."""
        share = self._held.damper_share(key)
        if share == 0.0:
            return
        self._sounding = [k for k in self._sounding if k != key]
        for event in self._damper_events(key, release):
            self.player.damp(event["body"], event["sigma"] * share, DAMPER_SECONDS, frame)

    def _move_pedal(self, name: str, value: float, frame: int) -> None:
        kept = self._held.kept
        if not self._held.move_pedal(name, value):
            return
        for key in self.keys if name == "sustain" else kept:
            if key not in self._held.down and key not in self._held.kept:
                self.lift(key, frame)
                self.damp(key, UNKNOWN_RELEASE / FULL_VELOCITY, frame)

    # --- events

    def _do(self, event: dict[str, Any], key: int, frame: int) -> None:
        """Let an event of a key happen."""
        if later := nearest_frame(event.get("time", 0.0), self.player.samplerate):
            frame = max(frame, self.player.frame) + later
        kind = event.get("kind")
        if kind == "strike":
            self.player.strike(event["body"], event["velocity"], event.get("displacement"), frame)
        elif kind == "pluck":
            full = self._full_amplitude(key, event["body"])
            if full and event["amplitude"] / full > 0.0:
                self.player.pluck(event["body"], event["amplitude"] / full, frame, self._places[key, event["body"]])
        elif kind == "damp":
            self.player.damp(event["body"], event["sigma"], event.get("duration", DAMPER_SECONDS), frame)
        elif kind == "change" and event.get("parameter") is not None:
            self.player.set(event["parameter"], event["value"], event.get("duration", CHANGE_SECONDS), frame)
            self.player.make_tables()  # what the key does next is done with them
        elif kind == "change":
            section = next(section for section in CHANGES_OF if event.get(section))
            for name in CHANGES_OF[section]:
                if event.get(name) is not None:
                    glide = event.get("duration", CHANGE_SECONDS)
                    self.player.set(f"{section}.{event[section]}.{name}", event[name], glide, frame)

    def _full_amplitude(self, key: int, body: str) -> float:
        """Return the full force of the pluck of a body that waits for its key, N."""
        names = {"v": 1.0, "soft": 0.0, "release": 0.5}
        events = [event for event, _, _ in events_of_key(self._writer, "on", key, names, 0.0)]
        return float(next((e["amplitude"] for e in events if e["kind"] == "pluck" and e["body"] == body), 0.0))
