"""The frames of a player at times of day."""

import time

from engine.live.player import Player

MAX_DRIFT = 0.2  # s, between two clocks before they are compared anew: a player's stands still during a block


class FrameClock:
    """Tells at which frame of a player something is to be done that has a time. Two times are as far apart in frames as
    they are in seconds."""

    def __init__(self) -> None:
        self._player: Player | None = None
        self._time, self._frame = 0.0, 0  # at which the clocks were compared

    def frame_at(self, player: Player, seconds: float) -> int:
        """Return the frame of a player at a time, s since 1970; the next one to come if that has passed."""
        now = time.time()
        drift = (now - self._time) - (player.frame - self._frame) / player.samplerate
        if player is not self._player or abs(drift) > MAX_DRIFT:
            self._player, self._time, self._frame = player, now, player.frame
        return max(player.frame, self._frame + round((seconds - self._time) * player.samplerate))
