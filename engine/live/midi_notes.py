"""Messages of MIDI as notes and moves of controllers, and ports. mido is imported when needed."""

from typing import Any, NamedTuple

from engine.live.mpe import ALL, MpeZones, NoteChannels

PEDALS = {64: "sustain", 66: "sostenuto", 67: "soft"}  # by their controllers
ALL_SOUND_OFF, ALL_NOTES_OFF = 120, 123  # controllers
UNKNOWN_RELEASE = 64  # velocity with which a key is let go, where that was not measured


class MidiError(RuntimeError):
    """The notes cannot be played. The message says why and what to do."""


class NothingToPlay(MidiError):
    """A patch has no notes to play."""


class Note(NamedTuple):
    """A message."""

    seconds: float
    kind: str  # on | off | bend | the name of a pedal
    number: int  # of the key
    value: float  # velocity; how far a pedal is down, 0 to 127; how far the pitch is bent, cents
    channels: NoteChannels = NoteChannels(ALL, ALL)  # of an MPE zone, whose bends it follows; or that are bent
    part: int = 0  # of a file; of a port, the channel, from 1


class Move(NamedTuple):
    """A move of a controller."""

    kind: str  # of a [[control]]
    number: int  # of the controller, or of the key
    channel: int  # from 1
    value: float  # 0 to 1


def load_mido() -> Any:
    """The module mido. Raises MidiError."""
    try:
        import mido
    except ImportError:
        raise MidiError("notes need mido; run uv sync --extra midi, or pip install mido python-rtmidi") from None
    return mido


def parse_message(message: Any, seconds: float, zones: MpeZones) -> Note | None:
    """A message as a Note, if it is one."""
    if message.type in ("note_on", "note_off"):
        channels = zones.channels(message.channel + 1)
        if message.type == "note_on" and message.velocity > 0:
            return Note(seconds, "on", message.note, message.velocity, channels)
        return Note(seconds, "off", message.note, message.velocity or UNKNOWN_RELEASE, channels)
    if message.type == "control_change" and message.control in PEDALS:
        return Note(seconds, PEDALS[message.control], 0, message.value)
    if message.type == "pitchwheel":
        channel = message.channel + 1
        return Note(seconds, "bend", 0, zones.bend_cents(channel, message.pitch), zones.channels(channel))
    return None


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


def list_ports() -> list[str]:
    """The names of the MIDI input ports. Raises MidiError."""
    try:
        return list(load_mido().get_input_names())
    except (ImportError, OSError) as error:
        raise MidiError(f"there are no MIDI ports ({error}); run uv sync --extra midi, or give a .mid file") from error


def open_port(name: str) -> Any:
    """An open input port of a name, or of a part of it. Raises MidiError."""
    names = list_ports()
    chosen = [n for n in names if name.lower() in n.lower()]
    if len(chosen) != 1:
        what = "several MIDI ports match" if chosen else "no MIDI port is called"
        raise MidiError(
            f'{what} "{name}"; the ports are {", ".join(names) or "none"}; give one of these, or a .mid file'
        )
    return load_mido().open_input(chosen[0])
