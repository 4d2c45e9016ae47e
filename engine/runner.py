"""Runs a Model: its parts one after another or on several cores, with the same samples bit for bit."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from engine import energy
from engine.block import block
from engine.model import Model, State, Trace


class Runner:
    """A Model at work on its State.

    cores:   how many to use; more than the scene has parts are of no use
    metered: measure the energies of every sample
    """

    def __init__(self, model: Model, state: State, cores: int = 1, metered: bool = True) -> None:
        self.model, self.state, self.metered = model, state, metered
        self.parts = model.islands.part.size - 1
        self.cores = min(cores, self.parts)
        self.tally = np.zeros(energy.TALLY)
        self._room: list[tuple[np.ndarray, np.ndarray | None]] = []
        self._pool = ThreadPoolExecutor(self.cores) if self.cores > 1 else None

    def block(self, out: np.ndarray, trace: Trace | None = None) -> None:
        """Render len(out) samples into out [frames, channels]; a trace is filled by one core."""
        frames = len(out)
        if not self._room or len(self._room[0][0]) < frames or self._room[0][0].shape[1:] != out.shape[1:]:
            ledgers = [np.empty((frames, energy.COLUMNS)) if self.metered else None for _ in range(self.parts)]
            self._room = [(np.empty_like(out), ledger) for ledger in ledgers]
        room = [(own[:frames], None if ledger is None else ledger[:frames]) for own, ledger in self._room]
        room[0] = (out, room[0][1])

        def run(part: int) -> None:
            block(self.model, self.state, part, room[part][0], room[part][1], trace)

        if self._pool is None or trace is not None:
            for part in range(self.parts):
                run(part)
        else:
            list(self._pool.map(run, range(self.parts)))
        total = room[0][1]
        for own, ledger in room[1:]:  # in the same order however they ran
            out += own
            if total is not None and ledger is not None:
                total += ledger
        if total is not None:
            energy.audit(total, self.tally)

    def energies(self) -> dict[str, Any]:
        """Energies up to now (engine.energy)."""
        return energy.summary(self.tally, self.state.account)


def timed(runner: Runner, out: np.ndarray) -> float:
    """Seconds that a block takes."""
    begin = time.perf_counter()
    runner.block(out)
    return time.perf_counter() - begin
