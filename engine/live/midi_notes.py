"""Messages of MIDI as notes and moves of controllers."""

from typing import Any, NamedTuple

from engine.instrument.held_keys import ALL
from engine.live.midi_drivers import MidiError
from engine.live.mpe import DATA, DATA_FINE, DECREMENT, INCREMENT, NRPN, RPN_HIGH, RPN_LOW, MpeZones, NoteChannels

PEDALS = {64: "sustain", 66: "sostenuto", 67: "soft"}  # by their controllers
FIRST_MODE_MESSAGE = 120  # controllers from here on are messages to a channel
ALL_SOUND_OFF = 120  # controller
PITCH_KINDS = "bend", "tune"  # of messages that change the pitch of notes
NOT_OF_SCORE = (*PITCH_KINDS, "program")  # kinds of messages that no score of keys has
PEDAL_DOWN = 64  # of 127; below, a pedal is up
NOTES_OFF = range(123, 128)  # controllers: all notes off, and the modes (omni, mono, poly), which mean that as well
PARAMETER_CONTROLLERS = DATA, DATA_FINE, INCREMENT, DECREMENT, *NRPN, RPN_LOW, RPN_HIGH  # the order counts
UNKNOWN_RELEASE = 64  # velocity with which a key is let go, where that was not measured


class NothingToPlay(MidiError):
    """A patch has no notes to play."""


class Note(NamedTuple):
    """A message."""

    seconds: float
    kind: str  # on | off | bend | tune | silence | program | the name of a pedal
    number: int  # of the key
    value: float  # velocity; how far a pedal is down, 0 to 127; how far the pitch is bent, or a key tuned, cents
    channels: NoteChannels = NoteChannels(ALL, ALL)  # that it follows, or whose message it is
    part: int = 0  # of a file; of a port, the channel, from 1


class Move(NamedTuple):
    """A move of a controller."""

    kind: str  # of a [[control]]
    number: int  # of the controller, or of the key
    channel: int  # from 1
    value: float  # 0 to 1


def parse_message(message: Any, seconds: float, zones: MpeZones) -> Note | None:
    """A message as a Note, if it is one."""
    if message.type in ("note_on", "note_off"):
        channels = zones.channels(message.channel + 1)
        if message.type == "note_on" and message.velocity > 0:
            return Note(seconds, "on", message.note, message.velocity, channels)
        return Note(seconds, "off", message.note, message.velocity or UNKNOWN_RELEASE, channels)
    if message.type == "control_change" and message.control in PEDALS:
        return Note(seconds, PEDALS[message.control], 0, message.value, zones.channels(message.channel + 1))
    if message.type == "control_change" and message.control == ALL_SOUND_OFF:
        return Note(seconds, "silence", 0, 0.0, zones.channels(message.channel + 1))
    if message.type == "pitchwheel":
        channel = message.channel + 1
        return Note(seconds, "bend", 0, zones.move_wheel(channel, message.pitch), zones.channels(channel))
    if message.type == "program_change":
        return Note(seconds, "program", 0, message.program, zones.channels(message.channel + 1))
    return None


def bends_of(zones: MpeZones, seconds: float) -> list[Note]:
    """The bends that the last message caused, of ranges, tunings and zones; and the keys that it tuned."""
    bends = [Note(seconds, "bend", 0, zones.cents(channel), zones.channels(channel)) for channel in zones.bent]
    return bends + [Note(seconds, "tune", key, cents) for key, cents in zones.tuned.items()]


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
