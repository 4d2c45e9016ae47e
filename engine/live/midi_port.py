"""Messages of a MIDI port: the latest move of each controller counts, and a port that vanishes lets its notes go."""

import time
from collections import deque
from collections.abc import Callable, Iterable
from itertools import islice
from typing import Any

from engine.instrument.tables import drum_keys
from engine.live.controls import Controls
from engine.live.general_midi import DRUM_CHANNEL
from engine.live.key_allocator import KeyAllocator
from engine.live.midi_drivers import MidiError, list_ports, open_port
from engine.live.midi_notes import (
    FIRST_MODE_MESSAGE,
    NOTES_OFF,
    PARAMETER_CONTROLLERS,
    PEDAL_DOWN,
    PEDALS,
    bends_of,
    parse_message,
    parse_move,
)
from engine.live.midi_recording import MidiRecording
from engine.live.mpe import RESET_CONTROLLERS, MpeZones
from engine.live.rig_keys import RigKeys
from engine.live.voice_allocator import VoiceAllocator

Allocator = VoiceAllocator | KeyAllocator | RigKeys
MAX_READ, MAX_AT_ONCE = 4096, 64  # messages that are read, and taken, between two looks at the other inputs
LOOK_SECONDS = 1.0  # between two looks at whether the port is there
CHANNELS = range(1, 17)
PEDAL = "pedal"  # kind of a controller


class MidiPort:
    """Notes and moves of controllers that come from a port, as a session polls them.

    name:      of the port, or a part of it
    allocator: returns what plays the notes now; None if nothing does
    say:       called with a line when the port vanishes, and when it is back
    record:    keeps what is played
    Raises MidiError if there is no such port.
    """

    def __init__(
        self,
        name: str,
        allocator: Callable[[], Allocator | None],
        controls: Controls,
        say: Callable[[str], None] = lambda line: None,
        record: MidiRecording | None = None,
    ) -> None:
        self._wanted, self._allocator, self._controls, self._say = name, allocator, controls, say
        self._record = record
        self._port: Any = open_port(name)
        self._name: str = self._port.name
        self._zones = MpeZones(controls.scene.midi, is_port=True)
        self._pending = deque[Any]()
        self._looked = time.monotonic()

    def poll(self) -> bool:
        """Take what has come, but no more than fits between two looks at other inputs. Returns False: a port has no
        end."""
        if self._port is not None:
            self._pending.extend(islice(self._port.iter_pending(), MAX_READ))
        if len(self._pending) > 1:
            self._pending = deque(leave_out_passing_moves(self._pending))
        for _ in range(min(len(self._pending), MAX_AT_ONCE)):
            self._take(self._pending.popleft())
        if time.monotonic() - self._looked >= LOOK_SECONDS:
            self._look()
            self._looked = time.monotonic()
        return False

    def _take(self, message: Any) -> None:
        """Do what a message says."""
        if message.type == "note_on" and message.velocity > 0:
            self._zones.hear(message.channel + 1)
        allocator = self._allocator()
        if self._record is not None and message.type != "clock":
            self._record.add(message, self._controls.player)
        if allocator is not None:
            allocator.together, allocator.controls = self._zones.together, self._controls
        if isinstance(allocator, VoiceAllocator):
            allocator.bends_later = True
        for one in self._zones.expand(message):
            if not self._zones.feed(one):
                take_message(one, self._zones, allocator, self._controls)
            elif allocator is not None:
                for channel in self._zones.regrouped:  # the release of a key would not find its note in the new zone
                    allocator.release_all(channel)
                for note in bends_of(self._zones, 0.0):
                    allocator.play(note)

    def _look(self) -> None:
        """Let the notes of a port go that has vanished; open it again when it is back."""
        if self._port is not None and not is_there(self._port, self._name):
            self._port.close()
            self._port = None
            self._let_go()
            self._say(f"MIDI: {self._name} is gone, and its notes are let go; it is taken up again when it is back")
        elif self._port is None:
            try:
                self._port = open_port(self._wanted)
            except MidiError:
                return
            self._name = self._port.name
            self._say(f"MIDI: {self._name} is back")

    def _let_go(self) -> None:
        """Let go of all keys, lift all pedals, and put the wheels in the middle."""
        self._pending.clear()
        allocator = self._allocator()
        if allocator is None:
            return
        for channel in CHANNELS:
            allocator.release_all(channel)
        from mido import Message

        reset = Message("control_change", control=RESET_CONTROLLERS)
        for channel in CHANNELS:
            self._take(reset.copy(channel=channel - 1))


def is_there(port: Any, name: str) -> bool:
    """True if an open port, which had a name, can still be heard."""
    driver = getattr(port, "_rt", None)  # of python-rtmidi, which can be asked without a new client
    try:
        return name in (list_ports() if driver is None else driver.get_ports())
    except MidiError:
        return False


def controller_of(message: Any) -> tuple[Any, ...] | None:
    """Return which controller a message moves, and whether a pedal is down; None if it is no move, or one of those
    that set parameters together."""
    if message.type == "control_change":
        if message.control >= FIRST_MODE_MESSAGE or message.control in PARAMETER_CONTROLLERS:
            return None
        if message.control in PEDALS:
            return PEDAL, message.channel, message.control, message.value >= PEDAL_DOWN
        return message.type, message.channel, message.control
    if message.type in ("pitchwheel", "aftertouch"):
        return message.type, message.channel
    return (message.type, message.channel, message.note) if message.type == "polytouch" else None


def leave_out_passing_moves(messages: Iterable[Any]) -> list[Any]:
    """Return messages without those moves after which the same controller moves again before anything else happens than
    moves of controllers. A pedal that goes up and down damps notes: of pedals, the order counts too."""
    kept, moved = list[Any](), set[tuple[Any, ...]]()
    for message in reversed(list(messages)):
        controller = controller_of(message)
        if controller is None:
            moved.clear()
        elif controller in moved:
            continue
        else:
            if controller[0] == PEDAL:
                moved = {one for one in moved if one[0] != PEDAL}
            moved.add(controller)
        kept.append(message)
    return kept[::-1]


def take_message(message: Any, zones: MpeZones, keys: Allocator | None, controls: Controls) -> bool:
    """Play the note of a message, or move the controls that it is for. Returns True if it moves controls."""
    move = parse_move(message)
    if is_taken := move is not None and controls.takes(move):
        assert move is not None
        targets = None if keys is None else keys.targets(move, zones.is_of_one_note(move.channel))
        controls.move(move, targets)
    note = None if is_taken and message.type == "pitchwheel" else parse_message(message, 0.0, zones)
    if note and note.kind in ("on", "off") and zones.part_channel(message.channel + 1) == DRUM_CHANNEL:
        drums = drum_keys(controls.scene.instrument) or {}
        note = note._replace(number=drums.get(note.number, note.number))
    if note and keys is not None:
        keys.play(note._replace(part=message.channel + 1))
    if message.type == "control_change" and keys is not None and message.control in NOTES_OFF:
        keys.release_all(message.channel + 1)
    return is_taken
