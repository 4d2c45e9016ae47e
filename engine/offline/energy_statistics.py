"""The energy balance over a whole render."""

from dataclasses import dataclass

import numpy as np

from engine.kernel.codes import Balance, EnergyTotal
from engine.offline.record import Record


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


def energy_statistics(balance: np.ndarray, energy_totals: np.ndarray) -> EnergyStatistics:
    """The energies of what was rendered. balance: see Balance; energy_totals: State.energy_totals"""
    largest = balance[Balance.LARGEST] if balance[Balance.LARGEST] > 0 else 1.0
    with np.errstate(all="ignore"):  # energies may be infinite
        return EnergyStatistics(
            initial=float(balance[Balance.INITIAL]),
            final=float(balance[Balance.FINAL]),
            supplied=float(energy_totals[:, EnergyTotal.SUPPLIED].sum()),
            dissipated=float(energy_totals[:, EnergyTotal.DISSIPATED].sum()),
            error_max=float(balance[Balance.MAX_ERROR] / largest),
            error_per_step_max=float(balance[Balance.MAX_ERROR_PER_STEP] / largest),
        )
