"""Motion that is too large for the models of bodies, of live sound (engine.offline.large_motion)."""

import numpy as np

from engine.live.player import Player
from engine.offline.large_motion import LargeMotion


class MotionWatch:
    """Looks now and then at how far the bodies move that a player plays, while another thread may render them."""

    def __init__(self, player: Player) -> None:
        self._lines: list[str] = []  # of players that were left
        self._use(player)

    def _use(self, player: Player) -> None:
        self._player = player
        names = [body.name for body in player.patch.body] * max(1, player.voices)
        self._motion = LargeMotion(player.memory.models[0], player.state, player.layout, names)

    def follow(self, player: Player) -> None:
        """Go on with the player of an edited patch."""
        self._lines = self.warnings()
        self._use(player)

    def poll(self) -> None:
        """Look at the motion."""
        with np.errstate(all="ignore"):  # a state that is not finite is reported elsewhere
            self._motion.look(self._player.frame)

    def warnings(self) -> list[str]:
        """Return a warning of each body whose motion was too large."""
        return list(dict.fromkeys(self._lines + self._motion.warnings(self._player.samplerate)))
