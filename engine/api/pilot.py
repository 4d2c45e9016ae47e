"""Test runs of a scene before it is played: how fast it is computed, and which gain brings it to a good level."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from engine.analysis.silence import is_inaudible
from engine.instrument.key_sequencer import FULL_VELOCITY
from engine.live.key_allocator import KeyAllocator
from engine.live.midi_notes import Note
from engine.live.player import HEADROOM, Player
from engine.live.shared_memory import Gauge
from engine.patch.frames import frame_count

WINDOW = 0.05  # s, of which the dearest counts
KEY_SECONDS = 0.25  # of a key that is played to find the level of an instrument
RETRIES = 2  # of a scene that seems too heavy


@dataclass(frozen=True)
class Pilot:
    """Test runs of the players of a scene, which give no output.

    make:        makes a player at a gain of 1, which nothing ends
    block:       frames at a time
    sound_limit: seconds of the scene that are played at most
    time_limit:  seconds that a run takes at most
    plays_keys:  the scene is an instrument that waits for notes: its level is that of its middle key, as loud as can
                 be. What waits otherwise is struck at once
    """

    make: Callable[[], Player]
    block: int
    sound_limit: float
    time_limit: float = math.inf
    plays_keys: bool = False

    @cached_property
    def player(self) -> Player:
        """The player of the first run."""
        return self.make()

    @cached_property
    def gain(self) -> float:
        """The gain at which the first run, and the middle key, reach half of full scale; 1 for silence."""
        _ = self._first_run
        if self.plays_keys:
            self._press_middle_key(self.player)
        peak = float(self.player.gauges[Gauge.PEAK])
        is_silent = peak == 0.0 or (not self.plays_keys and is_inaudible(self.player.patch))
        return 1.0 if is_silent else HEADROOM / peak

    @cached_property
    def speed(self) -> float:
        """Times real time that the dearest stretch of the scene runs at. The machine may have been busy with something
        else: what seems too dear is played anew, by another player, and of each stretch the quickest counts."""
        costs = self._first_run
        for _ in range(RETRIES):
            if costs.max(initial=0.0) > 1.0:
                repeated = self._run(self.make(), costs.size)
                costs[: repeated.size] = np.minimum(costs[: repeated.size], repeated)
        return 1.0 / float(costs.max(initial=1e-9))

    @cached_property
    def _first_run(self) -> np.ndarray:
        return self._run(self.player, math.inf)

    def _run(self, player: Player, most: float) -> np.ndarray:
        """Play a scene. Returns the time spent per time of sound, of each stretch.

        most: stretches that are played
        """
        if player.waiting and not self.plays_keys:
            player.strike()
        rate = player.samplerate
        out, costs, spent, played = np.zeros((self.block, player.channels), np.float32), list[float](), 0.0, 0
        limit, started = frame_count(min(self.sound_limit, player.scene.seconds), rate), time.perf_counter()
        while player.frame < limit and time.perf_counter() - started < self.time_limit and len(costs) < most:
            begin = time.perf_counter()
            player.render_into(out)
            spent, played = spent + time.perf_counter() - begin, played + self.block
            if played >= WINDOW * rate:
                costs.append(spent / played * rate)
                spent, played = 0.0, 0
        if played and not costs:
            costs.append(spent / played * rate)
        return np.array(costs)

    def _press_middle_key(self, player: Player) -> None:
        """Play the middle key of an instrument as loud as can be."""
        keys = KeyAllocator(player)
        keys.play(Note(0.0, "on", keys.keys[len(keys.keys) // 2], FULL_VELOCITY))
        for _ in range(math.ceil(KEY_SECONDS * player.samplerate / self.block)):
            player.render_into(np.zeros((self.block, player.channels), np.float32))
