"""The keys of an instrument, played live: what its sequencer says is put into the queue of a player."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

from engine.instrument.bent_parameters import bent_parameters
from engine.instrument.expansion import expand_keys, keys_of
from engine.instrument.held_keys import ALL
from engine.instrument.key_frequencies import frequencies_of
from engine.instrument.key_names import note_name, plain_note_name
from engine.instrument.key_sequencer import FULL_VELOCITY, Cancel, KeyEvent, KeySequencer, Message
from engine.instrument.key_writer import KeyWriter
from engine.instrument.score import Score
from engine.live.controls import Controls, Targets, targets_of_all
from engine.live.event_queue import RowSet, make_event, make_row_set
from engine.live.key_bends import KeyBends
from engine.live.midi_notes import PEDALS, PITCH_KINDS, Move, Note
from engine.live.player import Player
from engine.patch.frames import nearest_frame
from engine.patch.rig import Member, Rig, rename
from engine.patch.scene import Scene, join_scenes
from engine.patch.tables import ChangeEvent, DampEvent, LiftEvent, PluckEvent, StrikeEvent

TABLES: tuple[Any, ...] = (StrikeEvent, PluckEvent, DampEvent, LiftEvent, ChangeEvent)
KINDS = {get_args(table.model_fields["kind"].annotation)[0]: table for table in TABLES}


def live_scene(scene: Scene, keys: Sequence[int] | None = None) -> Scene:
    """An instrument with some keys, or all, at rest with its dampers down, to be played; or a rig with all keys. Raises
    ValueError if it is none, PatchError if the patch has an error at one of them."""
    if scene.rig is not None:
        return live_rig(scene.rig, {})
    document = scene.instrument
    if document is None:
        raise ValueError("the patch is not an instrument; an instrument has a [keyboard]")
    chosen = keys_of(document["keyboard"]) if keys is None else list(keys)
    played = scene.with_expansion(expand_keys(document, chosen, Score(), is_live=True))
    return played.model_copy(update={"accuracy": scene.accuracy})


def live_rig(rig: Rig, keys: Mapping[str, Sequence[int]]) -> Scene:
    """A rig at rest, to be played. keys: of its parts, by their names; all of a part that is not there"""
    return join_scenes(rig, [live_scene(member.scene, keys.get(member.name)) for member in rig.members])


class KeyAllocator:
    """Plays the keys of an instrument. player: of a `live_scene`, with `waiting = True`; member: part of its rig, whose
    groups of events have numbers from `first_set` on

    controls: that notes begin with what their channels have moved; None if nothing does
    """

    controls: Controls | None = None

    def __init__(self, player: Player, member: Member | None = None, first_set: int = 0) -> None:
        document = player.patch.instrument if member is None else member.document
        self.prefix = "" if member is None else member.prefix
        if document is None:
            raise ValueError("the patch is not an instrument; an instrument has a [keyboard]")
        self.player = player
        writer = KeyWriter(document)
        self.refused = 0
        self.ignored: dict[str, int] = {}  # messages, by what they are
        self.keys = [key for key in keys_of(document["keyboard"]) if self._is_written(writer, key)]
        for key in self.keys:
            writer.write_key(key)
        self.sequencer = KeySequencer(writer, self.keys)
        self._played: dict[int, int] = {}
        self._first_set = first_set
        self._damper_rows: dict[tuple[int, float], RowSet] = {}
        self._on_channel: dict[int, int] = {}  # of an MPE zone: the key pressed last
        self._of_keys: dict[str, list[tuple[str, int | None]]] = {}  # live parameters of a path, and whose key's
        self._names = {plain_note_name(key): key for key in self.keys}
        bodies = [body.model_dump(exclude_unset=True) for body in player.scene.body]
        bent = [one for one in bent_parameters(bodies, self.keys, self.prefix) if one.path in player.live_paths]
        self._bends = KeyBends(bent, frequencies_of(document["keyboard"]))
        self._bent = {one.path: one.value for one in bent}

    def take_over(self, other: object) -> None:
        """Go on from where another one was: pedals and wheels stay as they are, and what was counted counts. One of
        another kind leaves nothing."""
        if not isinstance(other, KeyAllocator):
            return
        self._bends.take_over(other._bends)
        self.together = other.together
        for name, value, channel in other.sequencer.pedal_moves():
            self._move_pedal(name, value, channel, 0)
        for key, count in other._played.items():
            self._played[key] = self._played.get(key, 0) + count
        self.refused += other.refused
        self.sequencer.stolen += other.sequencer.stolen
        self.ignored |= other.ignored

    @property
    def together(self) -> bool:
        """True if wheels and pedals act on the notes of all channels."""
        return self.sequencer.together

    @together.setter
    def together(self, together: bool) -> None:
        self.sequencer.together = self._bends.together = together

    @property
    def stolen(self) -> int:
        """Notes that ended for want of others."""
        return self.sequencer.stolen

    def played_notes(self) -> dict[str, str]:
        """Count the notes of each key that was played."""
        return {note_name(key): f"{count} times" for key, count in sorted(self._played.items())}

    def play(self, note: Note, frame: int = 0) -> None:
        """Do what a message says, at a frame."""
        self._bends.follow(note)
        if note.kind == "program":  # of no rig, which takes it itself
            self.ignored["program change"] = self.ignored.get("program change", 0) + 1
            return
        if note.kind in PITCH_KINDS:
            if not self._bent:
                self.ignored["pitch bend"] = self.ignored.get("pitch bend", 0) + 1
            return
        if note.kind == "on" and note.number not in self.keys:
            self.refused += 1
            return
        if note.kind == "on":
            self._on_channel[note.channels.channel] = note.number
            self._played[note.number] = self._played.get(note.number, 0) + 1
            self._begin_controls(note, frame)
        value = note.value / FULL_VELOCITY
        if note.kind in PEDALS.values():
            self._move_pedal(note.kind, value, note.channels.channel, frame)
        else:
            channels = note.channels.followed()
            self.do(self.sequencer.take(Message(0.0, note.kind, note.number, value, note.part, channels)), frame)

    def _move_pedal(self, name: str, value: float, channel: int, frame: int) -> None:
        """Move a pedal: one event moves the dampers of all keys that go with it."""
        moved = self.sequencer.move_pedal(name, value, channel)
        self.player.play_sets([name, value], [self._dampers(*one) for one in moved], frame)

    def _dampers(self, key: int, share: float) -> RowSet:
        """Return the events by which a pedal moves the dampers of a key."""
        if (key, share) not in self._damper_rows:
            tables = [rename(event.table, self.prefix) for event in self.sequencer.move_dampers(key, share)]
            events = [make_event(KINDS[table["kind"]], **(table | {"time": 0.0})) for table in tables]
            rows = [row for event in events for row in self.player.rows.of_event(event)]
            self._damper_rows[key, share] = make_row_set(self._first_set + len(self._damper_rows), rows)
        return self._damper_rows[key, share]

    def release_all(self, part: int, frame: int = 0) -> None:
        """Let go of all keys that a part, or a channel, holds."""
        self.do(self.sequencer.release_part(part), frame)

    def do(self, events: Iterable[KeyEvent | Cancel], frame: int) -> None:
        """Let events of keys happen at a frame, or later if they say so."""
        for event in events:
            if isinstance(event, Cancel):
                self.player.cancel(event.note, frame)
                continue
            table, at = rename(event.table, self.prefix), frame
            if later := nearest_frame(table.get("time", 0.0), self.player.samplerate):
                at = max(frame, self.player.frame) + later
            one = make_event(KINDS[table["kind"]], **(table | {"time": 0.0}))
            self.player.play_event(one, at, event.note, event.is_release)
            if table.get("parameter") is not None and at <= self.player.frame:
                self.player.make_tables()  # what the key does next is done with them

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
        the keys of its channel, and of what all keys share. Keys that no channel has played follow all channels."""
        is_of_key = move.kind == "poly_pressure"
        if self.together and not is_of_one_note and not is_of_key:
            return None

        def is_concerned(key: int | None) -> bool:
            if is_of_one_note or is_of_key:
                wanted = move.number if is_of_key else self._on_channel.get(move.channel)
                return key is not None and key == wanted
            return key is None or self.sequencer.follows(key, move.channel)

        return lambda player, path: [one for one, key in self._by_key(player, path) if is_concerned(key)]

    def _by_key(self, player: Player, path: str) -> list[tuple[str, int | None]]:
        """Return the live parameters that a path of the patch stands for, each with its key; None of what keys
        share."""
        if path not in self._of_keys:
            parameters = targets_of_all(player, path)
            keys = [self._names.get(self._own(".".join(one.split(".")[1:2])).partition("_")[0]) for one in parameters]
            self._of_keys[path] = list(zip(parameters, keys, strict=True))
        return self._of_keys[path]

    def _begin_controls(self, note: Note, frame: int) -> None:
        """Let a note begin with what the controllers of its channels say."""
        channels = note.channels
        if self.controls is None or channels.channel == ALL or (self.together and channels.master == ALL):
            return

        def targets(player: Player, path: str) -> list[str]:
            return [one for one, key in self._by_key(player, path) if key == note.number]

        self.controls.begin_note(targets, channels.followed(), note.number, max(frame, self.player.frame))

    def _own(self, name: str) -> str:
        """A name of the scene as the patch of the instrument has it; "" of another part's."""
        return name.removeprefix(self.prefix) if name.startswith(self.prefix) else ""

    def _is_written(self, writer: KeyWriter, key: int) -> bool:
        """True if the scene was written out with a key; one without bodies of its own, such as an open string, plucks
        bodies of the scene."""
        if any(True for _ in writer.tables_at("body", key)):
            of_key = f"{self.prefix}{plain_note_name(key)}_"
            return any(body.startswith(of_key) for body in self.player.layout.body_index)
        tables = [table for _, table in writer.tables_at("on", key) if table.get("kind") == "pluck"]
        plucked = {f"{self.prefix}{table.get('body')}" for table in tables}
        return plucked <= {force.body for force in self.player.scene.force}
