"""The energy balance over a whole render, from the ledger of its blocks (engine.kernel.energy)."""

from dataclasses import dataclass, field

import numpy as np

from engine.kernel.codes import EnergyTotal, Ledger
from engine.offline.record import Record

BUFFERED_ROWS = 4096  # samples whose energies are audited together: to do so costs 30 µs


@dataclass(frozen=True)
class EnergyStatistics(Record):
    """Energies in joule; errors relative to the largest energy that the scene has held, kinetic and potential counted
    each without sign."""

    initial: float
    final: float
    supplied: float
    dissipated: float
    error_max: float
    error_per_step_max: float


@dataclass
class EnergyAudit:
    """Follows the balance stored + dissipated - supplied over the rows of a ledger."""

    initial: float = 0.0  # stored energy, J
    final: float = 0.0
    initial_balance: float = 0.0
    last_balance: float = 0.0
    largest: float = 0.0  # of the stored energy, all parts without their signs
    max_error: float = 0.0
    max_error_per_step: float = 0.0
    rows: int = 0
    _buffer: np.ndarray = field(default_factory=lambda: np.empty((BUFFERED_ROWS, len(Ledger))))
    _buffered: int = 0

    def add(self, ledger: np.ndarray) -> None:
        """Take the ledger of a block [frames, columns]; it is audited when there is enough of it."""
        for begin in range(0, len(ledger), BUFFERED_ROWS):
            rows = ledger[begin : begin + BUFFERED_ROWS]
            if self._buffered + len(rows) > BUFFERED_ROWS:
                self.flush()
            self._buffer[self._buffered : self._buffered + len(rows)] = rows
            self._buffered += len(rows)

    @np.errstate(all="ignore")  # energies may be infinite
    def flush(self) -> None:
        """Audit what was taken."""
        ledger, self._buffered = self._buffer[: self._buffered], 0
        if len(ledger) == 0:
            return
        balance = ledger[:, Ledger.STORED] + ledger[:, Ledger.NET_DISSIPATED]
        if self.rows == 0:
            self.initial = float(ledger[0, Ledger.STORED])
            self.initial_balance = self.last_balance = float(balance[0])
        jumps = np.diff(balance, prepend=self.last_balance)
        # NumPy's max keeps a NaN
        self.largest = float(np.maximum(self.largest, ledger[:, Ledger.ABSOLUTE].max()))
        self.max_error = float(np.maximum(self.max_error, np.abs(balance - self.initial_balance).max()))
        self.max_error_per_step = float(np.maximum(self.max_error_per_step, np.abs(jumps).max()))
        self.rows += len(ledger)
        self.final, self.last_balance = float(ledger[-1, Ledger.STORED]), float(balance[-1])

    def summary(self, energy_totals: np.ndarray) -> EnergyStatistics:
        """The energies of what was taken. energy_totals: State.energy_totals"""
        self.flush()
        largest = self.largest if self.largest > 0 else 1.0
        with np.errstate(all="ignore"):
            return EnergyStatistics(
                initial=self.initial,
                final=self.final,
                supplied=float(energy_totals[:, EnergyTotal.SUPPLIED].sum()),
                dissipated=float(energy_totals[:, EnergyTotal.DISSIPATED].sum()),
                error_max=float(np.float64(self.max_error) / largest),
                error_per_step_max=float(np.float64(self.max_error_per_step) / largest),
            )
