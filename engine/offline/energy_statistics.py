"""The energy balance over a whole render."""

from dataclasses import dataclass

import numpy as np

from engine.kernel.data.enums import Balance, EnergyTotal
from engine.offline.statistics_base import Statistics


@dataclass(frozen=True)
class EnergyStatistics(Statistics):
    """Energies in joule; errors relative to the largest energy that the scene has held, kinetic and potential counted
    each without sign. What flies free at the end is counted up to the end of its flight, of 64 samples at most."""

    initial: float
    final: float
    supplied: float
    dissipated: float
    error_max: float
    error_per_step_max: float


def energy_statistics(balance: np.ndarray, energy_totals: np.ndarray) -> EnergyStatistics:
    """The energies of what was rendered. balance: see Balance; energy_totals: State.energy_totals"""
    largest = balance[Balance.LARGEST] if balance[Balance.LARGEST] > 0 else 1.0
    supplied, dissipated = (float(energy_totals[:, n].sum()) for n in (EnergyTotal.SUPPLIED, EnergyTotal.DISSIPATED))
    with np.errstate(all="ignore"):  # energies may be infinite
        return EnergyStatistics(
            initial=float(balance[Balance.INITIAL]),
            final=float(balance[Balance.LAST]) - (dissipated - supplied),
            supplied=supplied,
            dissipated=dissipated,
            error_max=float(balance[Balance.MAX_ERROR] / largest),
            error_per_step_max=float(balance[Balance.MAX_ERROR_PER_STEP] / largest),
        )
