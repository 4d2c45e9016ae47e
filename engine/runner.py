"""Runs a Model: its parts one after another or on several cores, with the same samples bit for bit."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from engine import energy
from engine.block import block
from engine.held import Held
from engine.model import Model, Room, State, Trace

LEAST = 1024  # samples there is room for at first
AUDITED = 4096  # samples whose energies are looked at together: to do so costs 30 µs


class Runner:
    """A Model at work on its State.

    cores:   how many to use; more than the scene has parts are of no use
    metered: measure the energies of every sample
    """

    def __init__(self, model: Model, state: State, cores: int = 1, metered: bool = True) -> None:
        self.model, self.state, self.metered = model, state, metered
        self.parts = model.islands.part.size - 1
        self.cores = min(cores, self.parts)
        self._tally = np.zeros(energy.TALLY)
        self._books, self._entries = np.empty((AUDITED if metered else 0, energy.COLUMNS)), 0
        self._held = Held(model), Held(state)
        self._rooms: list[Held] = []
        self._pool = ThreadPoolExecutor(self.cores) if self.cores > 1 else None

    def block(self, out: np.ndarray, trace: Trace | None = None) -> None:
        """Render len(out) samples into out [frames, channels]; a trace is filled by one core."""
        frames, rooms = len(out), self.rooms(*out.shape)
        if trace is not None:
            rooms = [Held(room.value._replace(trace=trace)) for room in rooms]

        def run(part: int) -> None:
            block(*self._held, rooms[part], part, frames)

        if self._pool is None or trace is not None:
            for part in range(self.parts):
                run(part)
        else:
            list(self._pool.map(run, range(self.parts)))
        own, ledger, _ = rooms[0].value
        out[:] = own[:frames]
        for room in rooms[1:]:  # in the same order however they ran
            out += room.value.out[:frames]
            if ledger is not None:
                ledger[:frames] += room.value.ledger[:frames]
        if ledger is not None:
            self._enter(ledger[:frames])

    def rooms(self, frames: int, channels: int) -> list[Held]:
        """A place for the block of each part."""
        if not self._rooms or len(self._rooms[0].value.out) < frames or self._rooms[0].value.out.shape[1] != channels:
            size = max(frames, LEAST)
            self._rooms = []
            for _ in range(self.parts):
                ledger = np.empty((size, energy.COLUMNS)) if self.metered else None
                self._rooms.append(Held(Room(np.empty((size, channels)), ledger, None)))
        return self._rooms

    def energies(self) -> dict[str, Any]:
        """Energies up to now (engine.energy)."""
        return energy.summary(self.tally, self.state.account)

    @property
    def tally(self) -> np.ndarray:
        """What energy.audit has found up to now."""
        energy.audit(self._books[: self._entries], self._tally)
        self._entries = 0
        return self._tally

    def _enter(self, ledger: np.ndarray) -> None:
        """Keep the energies of a block until there are enough to be looked at."""
        for begin in range(0, len(ledger), AUDITED):
            part = ledger[begin : begin + AUDITED]
            if self._entries + len(part) > AUDITED:
                energy.audit(self._books[: self._entries], self._tally)
                self._entries = 0
            self._books[self._entries : self._entries + len(part)] = part
            self._entries += len(part)


def timed(runner: Runner, out: np.ndarray) -> float:
    """Seconds that a block takes, there being room for it."""
    for room in runner.rooms(*out.shape):
        room.value.out[:] = 0.0  # memory is given when it is first written to
        if room.value.ledger is not None:
            room.value.ledger[:] = 0.0
    begin = time.perf_counter()
    runner.block(out)
    return time.perf_counter() - begin
