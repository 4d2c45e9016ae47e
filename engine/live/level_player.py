"""Volumes and pans of a MIDI file while it is played live."""

from engine.live.channel_levels import RAMP_SECONDS, ChannelLevels, Gain
from engine.live.player import Player
from engine.patch.frames import nearest_frame
from engine.patch.live_parameters import output_gain_path

LOOKAHEAD = 0.2  # s, by which gains are told before their time


class LevelPlayer:
    """The gains of a MIDI file, told to a player as their time comes near.

    lead:     s, by which the file begins later than the sound
    channels: of the patch; a sound of one channel is on all channels of the player
    """

    def __init__(self, levels: ChannelLevels, player: Player, lead: float, channels: int) -> None:
        self._gains = [gain._replace(seconds=gain.seconds + lead) for gain in levels.gains]
        self._on_channels, self._channels, self._begin = levels.on_channels, channels, 0
        self._is_plain = len(levels.gains) == 1 and levels.gains[0][1:] == (1.0, 1.0)
        self._start(player)

    def use(self, player: Player) -> None:
        """Go on with another player, which takes over now."""
        self._begin += self._player.frame
        self._start(player)

    def _start(self, player: Player) -> None:
        """Let a player begin with the gain of now."""
        self._player, now = player, self._begin / player.samplerate
        self._next = max(1, sum(gain.seconds <= now for gain in self._gains))
        if not self._is_plain:
            self._set(self._gains[self._next - 1], 0, 0.0)
            player.make_tables()

    def poll(self) -> None:
        """Tell the gains of the next moments."""
        rate = self._player.samplerate
        until = self._begin + self._player.frame + nearest_frame(LOOKAHEAD, rate)
        while self._next < len(self._gains) and nearest_frame(self._gains[self._next].seconds, rate) < until:
            gain = self._gains[self._next]
            self._set(gain, max(0, nearest_frame(gain.seconds, rate) - self._begin), RAMP_SECONDS)
            self._next += 1

    def _set(self, gain: Gain, frame: int, seconds: float) -> None:
        """Let the gains of the channels glide from a frame on."""
        values = self._on_channels(gain, self._channels)
        values = values * self._player.channels if len(values) == 1 else values
        self._player.set({output_gain_path(n): value for n, value in enumerate(values)}, seconds=seconds, frame=frame)
