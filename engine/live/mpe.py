"""MIDI Polyphonic Expression: zones of channels, in which each note has a channel, with a bend and a pressure of its
own (MPE 1.0, MIDI Manufacturers Association RP-053)."""

import math
from typing import Any, NamedTuple

from engine.instrument.held_keys import ALL
from engine.live.midi_tuning import Cents, read_tuning_message
from engine.patch.control_tables import Midi

LOWER_MASTER, UPPER_MASTER = 1, 16  # channels, counted from 1
MEMBERS = 15  # at most, of both zones
RPN_HIGH, RPN_LOW, DATA, DATA_FINE = 101, 100, 6, 38  # controllers that set registered parameters
INCREMENT, DECREMENT = 96, 97  # controllers that change the parameter by its smallest step
NRPN = 98, 99  # controllers that choose a parameter that is not registered
RESET_CONTROLLERS = 121  # controller; no parameter is chosen after it
MAX_RANGE = 127.99  # semitones; the range has semitones and cents
BEND_RANGE, FINE_TUNING, COARSE_TUNING, CONFIGURATION = (0, 0), (0, 1), (0, 2), (0, 6)  # registered parameters
CENTRE_COARSE, CENTRE_FINE = 64, 8192  # of the tunings: semitones, and 8192ths of one
TIMBRE = 74  # controller
NEUTRAL = {1: 0, 11: 127, 64: 0, 65: 0, 66: 0, 67: 0}  # of the controllers that are reset (RP-015)
RESET_KINDS = {"pitchwheel": "pitch", "aftertouch": "value", "polytouch": "value"}  # other messages, and what is 0 then


class NoteChannels(NamedTuple):
    """The channels whose bends, pressures and pedals a note follows.

    master: of the zone that it is in; ALL outside zones
    """

    channel: int
    master: int

    def followed(self) -> tuple[int, ...]:
        """The channel, and the master of its zone if there is one."""
        return (self.channel,) if self.master in (ALL, self.channel) else (self.channel, self.master)


class ChannelBends:
    """The bends of the pitch by the wheel of each channel.

    together: outside zones, all notes follow the latest move of any wheel
    """

    def __init__(self) -> None:
        self._cents: dict[int, float] = {}
        self.together = False

    def move(self, channels: NoteChannels, cents: float) -> None:
        """Move the wheel of a channel."""
        self._cents[channels.channel] = cents
        if channels.master == ALL:
            self._cents[ALL] = cents

    def ratio(self, channels: NoteChannels) -> float:
        """Return the ratio by which the frequencies of a note are bent, by its channel and the master of its zone."""
        followed = (ALL,) if self.together and channels.master == ALL else channels.followed()
        return float(2.0 ** (sum(self._cents.get(channel, 0.0) for channel in followed) / 1200.0))


class MpeZones:
    """The state of the channels of a port or a file, as the patch and its own messages set it: zones, ranges of bend,
    tunings, wheels.

    regrouped: channels that were, or now are, in a zone that the last message set
    bent:      channels that the last message bends without a move of their wheel
    tuned:     keys that the last message tunes
    together:  wheels and pedals outside zones act on the notes of all channels
    """

    def __init__(self, midi: Midi, is_port: bool = False) -> None:
        self.together = is_port and midi.channels != "apart"
        self._divides = midi.channels == "auto"  # as soon as a second channel plays
        self._playing: int | None = None  # the channel that plays
        self._plain_range = midi.bend_range
        self._pitch = dict.fromkeys(range(1, 17), 0)  # of the wheels, -8192 to 8191
        self._coarse = dict.fromkeys(range(1, 17), CENTRE_COARSE << 7)
        self._fine = dict.fromkeys(range(1, 17), CENTRE_FINE)
        self._moved: dict[tuple[int, str, int], Any] = {}  # messages that a reset undoes
        self.bent = list[int]()
        self.tuned: Cents = {}
        self._members = {LOWER_MASTER: 0, UPPER_MASTER: 0}
        self._range = dict.fromkeys(range(1, 17), midi.bend_range)  # semitones
        self._parameter: dict[int, list[int | None]] = {channel: [None, None] for channel in range(1, 17)}
        self._not_registered = set[int]()  # channels whose data are of an NRPN
        self._member_range = midi.mpe_bend_range
        self._configure(LOWER_MASTER, midi.mpe_lower)
        self._configure(UPPER_MASTER, midi.mpe_upper)
        self.regrouped: list[int] = []

    def feed(self, message: Any) -> bool:
        """Follow a message (of mido) if it sets a zone, a range of bend or a tuning; returns whether it does."""
        self.regrouped, self.bent, self.tuned = [], [], {}
        if message.type == "sysex":
            self.tuned = read_tuning_message(message.data)
            return True
        if message.type != "control_change":
            return False
        channel, control, value = message.channel + 1, message.control, message.value
        if control in (RPN_HIGH, RPN_LOW):
            self._parameter[channel][control == RPN_LOW] = value
            self._not_registered.discard(channel)
            return True
        if control in NRPN:
            self._not_registered.add(channel)
        elif control == RESET_CONTROLLERS:
            self._parameter[channel] = [None, None]
        if control not in (DATA, DATA_FINE, INCREMENT, DECREMENT) or channel in self._not_registered:
            return False
        before = self._all_cents()
        is_known = self._set_parameter(channel, control, value)
        self.bent = [one for one, cents in self._all_cents().items() if cents != before[one]]
        return is_known

    def _set_parameter(self, channel: int, control: int, value: int) -> bool:
        """Set the parameter that is chosen by a data controller. Return False if it has no meaning here."""
        chosen = tuple(self._parameter[channel])
        if control == DATA and chosen == CONFIGURATION and channel in self._members:
            self._regroup(channel, min(value, MEMBERS))
        elif chosen == BEND_RANGE:
            for other in self._zone_of(channel):
                self._range[other] = changed_range(self._range[other], control, value)
        elif chosen == FINE_TUNING:
            self._fine[channel] = changed_number(self._fine[channel], control, value, 1)
        elif chosen == COARSE_TUNING:
            self._coarse[channel] = changed_number(self._coarse[channel], control, value, 1 << 7)
        else:
            return control != DATA and chosen == CONFIGURATION
        return True

    def _all_cents(self) -> dict[int, float]:
        return {channel: self.cents(channel) for channel in self._pitch}

    def cents(self, channel: int) -> float:
        """Return by how many cents a channel is bent and tuned now."""
        return self.bend_cents(channel, self._pitch[channel])

    def move_wheel(self, channel: int, pitch: int) -> float:
        """Move the wheel of a channel to -8192 to 8191. Return by how many cents it is bent and tuned now."""
        self._pitch[channel] = pitch
        return self.cents(channel)

    def hear(self, channel: int) -> None:
        """Take notice of a note on a channel: where more than one plays, each has its own wheel and pedals."""
        if self.together and self._divides and self.master(channel) is None:
            self._playing = self._playing or channel
            self.together = channel == self._playing

    def expand(self, message: Any) -> list[Any]:
        """Return the messages (of mido) that a message stands for: reset all controllers (121), the moves that put what
        was moved where it was (RP-015); any other one, itself."""
        kind = message.type
        if kind == "control_change" and message.control in NEUTRAL:
            self._moved[message.channel, kind, message.control] = message
        elif kind in RESET_KINDS:
            self._moved[message.channel, kind, message.note if kind == "polytouch" else 0] = message
        if kind != "control_change" or message.control != RESET_CONTROLLERS:
            return [message]
        pedals_of_all = [one for one in self._moved if self.together and one[1] == kind and one[2] >= 64]
        chosen = [one for one in self._moved if one[0] == message.channel or one in pedals_of_all]
        return [message, *(neutral_message(self._moved.pop(one)) for one in sorted(chosen))]

    def channels(self, channel: int) -> NoteChannels:
        """Return the channels that a note on a channel follows."""
        master = self.master(channel)
        return NoteChannels(channel, ALL if master is None else master)

    def master(self, channel: int) -> int | None:
        """The master channel of the zone that a channel is in; None outside zones."""
        return next((master for master in self._members if channel in self._channels_of(master)), None)

    def part_channel(self, channel: int) -> int:
        """The channel, or the master of its zone."""
        return self.master(channel) or channel

    def is_of_one_note(self, channel: int) -> bool:
        """True if messages on a channel concern only the note on it."""
        return channel not in self._members and self.master(channel) is not None

    def bend_cents(self, channel: int, pitch: int) -> float:
        """Return the cents by which a pitch wheel at -8192 to 8191 and the tuning of its channel bend."""
        tuned = (self._coarse[channel] >> 7) - CENTRE_COARSE + (self._fine[channel] - CENTRE_FINE) / CENTRE_FINE
        return pitch / 8192 * 100.0 * self._range[channel] + 100.0 * tuned

    def _regroup(self, master: int, members: int) -> None:
        """Set a zone while notes may sound, and note the channels whose notes cannot go on as they were."""
        before, followed = self._channels_of(master), [self.channels(channel) for channel in range(1, 17)]
        self._configure(master, members)
        concerned = {*before, *self._channels_of(master)}
        for channel in concerned - {LOWER_MASTER, UPPER_MASTER} | {master}:  # a zone has none of what was before it
            is_member = self.master(channel) is not None and channel != master
            self._range[channel], self._pitch[channel] = self._member_range if is_member else self._plain_range, 0
        concerned |= {channel for channel, old in enumerate(followed, 1) if self.channels(channel) != old}
        self.regrouped = sorted(concerned)

    def _configure(self, master: int, members: int) -> None:
        """Give a zone so many member channels; the other zone gives up what it takes."""
        other = UPPER_MASTER if master == LOWER_MASTER else LOWER_MASTER
        self._members[master] = members
        if members and self._members[other]:
            self._members[other] = max(0, min(self._members[other], MEMBERS - 1 - members))
        for channel in self._channels_of(master):
            if channel != master:
                self._range[channel] = self._member_range

    def _channels_of(self, master: int) -> list[int]:
        count = self._members[master]
        if count == 0:
            return []
        step = 1 if master == LOWER_MASTER else -1
        return [master + step * n for n in range(count + 1)]

    def _zone_of(self, channel: int) -> list[int]:
        """The channels that a range of bend told on one of them is of: all members, or itself."""
        master = self.master(channel)
        if master is None or channel == master:
            return [channel]
        return [c for c in self._channels_of(master) if c != master]


def changed_number(number: int, control: int, value: int, step: int) -> int:
    """Return a number of 14 bits after a data controller: its upper or lower seven bits, or a step more or less."""
    if control == DATA:
        return value << 7 | number & 0x7F
    if control == DATA_FINE:
        return number & 0x3F80 | value
    return min(0x3FFF, max(0, number + (step if control == INCREMENT else -step)))


def neutral_message(message: Any) -> Any:
    """Return the message (of mido) that puts back what a message moved."""
    if message.type == "control_change":
        return message.copy(value=NEUTRAL[message.control])
    return message.copy(**{RESET_KINDS[message.type]: 0})


def changed_range(semitones: float, control: int, value: int) -> float:
    """Return a range of bend after a data controller: semitones, their cents, or a cent more or less."""
    if control == DATA:
        return float(value)
    if control == DATA_FINE:
        return math.floor(semitones) + min(value, 99) / 100
    cents = round(100 * semitones) + (1 if control == INCREMENT else -1)
    return min(MAX_RANGE, max(0.0, cents / 100))
