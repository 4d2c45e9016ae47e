"""The protocol of tables of speed: what is compared runs in turn, on one core unless it needs two, from one state each;
a time is the median of its turns, with their spread, and what spreads too far is measured again."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import engine
from engine.assembly.build import build
from engine.kernel.data.axes import arrays_of
from engine.offline.simulation import Simulation

RATE = 44_100
FRAMES = 16_384  # of a block, at most
TURNS = 9
LARGEST_SPREAD = 0.1  # of the median: with more, all is measured again …
TRIES = 3  # … so often at most, and what spread least is kept


class Timing(NamedTuple):
    """Seconds per sample."""

    least: float
    median: float
    spread: float  # half of the turns lie within so much of the median, as a share of it

    @property
    def nanoseconds(self) -> str:
        """The median and the spread, for a table."""
        ns = self.median * 1e9
        return f"{ns:.0f} ± {100 * self.spread:.0f} %" if ns >= 100 else f"{ns:.3g} ± {100 * self.spread:.0f} %"


class Replay:
    """A scene that is rendered again and again, from its state after a while.

    seconds:  of a turn
    warm:     s, after which the state is kept
    metered:  whether energies are measured
    silence:  dB, below which islands sleep; by default none does
    """

    def __init__(
        self,
        scene: engine.Scene,
        seconds: float,
        warm: float = 0.0,
        cores: int = 1,
        metered: bool = False,
        silence: float = -np.inf,
    ) -> None:
        model, state, _ = build(scene, RATE, scene.accuracy.replace(silence=silence))
        if not state.p.any() and not scene.force:
            state.p[:] = 1.0  # or it would sleep
        self.simulation = Simulation(model, state, cores, metered)
        self.audio = np.zeros((FRAMES, scene.channels))
        self.frames = round(seconds * RATE)
        self._render(64)  # loads the kernel
        self._render(max(0, round(warm * RATE) - 64))
        self._saved = [(array, array.copy()) for array in arrays_of(state)]

    def _render(self, frames: int) -> None:
        for begin in range(0, frames, FRAMES):
            self.simulation.render_block(self.audio[: min(FRAMES, frames - begin)])

    def __call__(self) -> float:
        """Render once, and return the seconds per sample."""
        for array, copy in self._saved:
            array[...] = copy
        begin = time.perf_counter()
        self._render(self.frames)
        return (time.perf_counter() - begin) / self.frames


def time_in_turn(*works: Callable[[], float], turns: int = TURNS) -> list[Timing]:
    """Return the times of what returns its seconds per sample, each run once in each turn."""
    best: list[Timing] = []
    for _ in range(TRIES):
        taken = np.array([[work() for work in works] for _ in range(turns)])
        low, middle, high = np.quantile(taken, (0.25, 0.5, 0.75), axis=0)
        spread = (high - low) / 2 / middle
        if not best or spread.max() < max(timing.spread for timing in best):
            least = taken.min(axis=0)
            best = [Timing(*map(float, numbers)) for numbers in zip(least, middle, spread, strict=True)]
        if spread.max() <= LARGEST_SPREAD:
            break
    return best
