"""MIDI Polyphonic Expression: zones of channels, in which each note has a channel, with a bend and a pressure of its
own (MPE 1.0, MIDI Manufacturers Association RP-053)."""

from typing import Any, NamedTuple

from engine.patch.control_tables import Midi

ALL = 0  # instead of a channel: outside zones, all notes follow the bends of all channels
LOWER_MASTER, UPPER_MASTER = 1, 16  # channels, counted from 1
MEMBERS = 15  # at most, of both zones
RPN_HIGH, RPN_LOW, DATA, DATA_FINE = 101, 100, 6, 38  # controllers that set registered parameters
BEND_RANGE, CONFIGURATION = (0, 0), (0, 6)  # registered parameters
TIMBRE = 74  # controller


class NoteChannels(NamedTuple):
    """The channels whose bends and pressures a note follows."""

    channel: int
    master: int


class ChannelBends:
    """The bends of the pitch by the wheel of each channel."""

    def __init__(self) -> None:
        self._cents: dict[int, float] = {}

    def move(self, channel: int, cents: float) -> None:
        """Move the wheel of a channel."""
        self._cents[channel] = cents

    def ratio(self, channels: NoteChannels) -> float:
        """Return the ratio by which the frequencies of a note are bent, by its channel and the master of its zone."""
        return float(2.0 ** (sum(self._cents.get(channel, 0.0) for channel in set(channels)) / 1200.0))


class MpeZones:
    """The zones of a port or a file, as the patch and its own messages set them."""

    def __init__(self, midi: Midi) -> None:
        self._members = {LOWER_MASTER: 0, UPPER_MASTER: 0}
        self._range = dict.fromkeys(range(1, 17), midi.bend_range)  # semitones
        self._parameter: dict[int, list[int | None]] = {channel: [None, None] for channel in range(1, 17)}
        self._member_range = midi.mpe_bend_range
        self._configure(LOWER_MASTER, midi.mpe_lower)
        self._configure(UPPER_MASTER, midi.mpe_upper)

    def feed(self, message: Any) -> bool:
        """Follow a message (of mido) if it sets a zone or a range of bend; returns whether it does."""
        if message.type != "control_change":
            return False
        channel, control, value = message.channel + 1, message.control, message.value
        if control in (RPN_HIGH, RPN_LOW):
            self._parameter[channel][control == RPN_LOW] = value
            return True
        chosen = tuple(self._parameter[channel])
        if control == DATA and chosen == CONFIGURATION and channel in self._members:
            self._configure(channel, min(value, MEMBERS))
        elif control == DATA and chosen == BEND_RANGE:
            for other in self._zone_of(channel):
                self._range[other] = float(value)
        else:
            return control == DATA_FINE and chosen in (BEND_RANGE, CONFIGURATION)
        return True

    def channels(self, channel: int) -> NoteChannels:
        """Return the channels that a note on a channel follows."""
        master = self.master(channel)
        return NoteChannels(ALL, ALL) if master is None else NoteChannels(channel, master)

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
        """Return the cents that a pitch wheel at -8192 to 8191 bends."""
        return pitch / 8192 * 100.0 * self._range[channel]

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
