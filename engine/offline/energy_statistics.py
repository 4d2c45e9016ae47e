"""The energy balance over a whole render."""

from dataclasses import dataclass

import numpy as np

from engine.assembly.free_flight import map_of_step
from engine.kernel.data.effects import WEIGHT
from engine.kernel.data.enums import FLIGHT_FRAMES, Balance, EnergyTotal, FlightFrame
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.offline.statistics_base import Statistics


@dataclass(frozen=True)
class EnergyStatistics(Statistics):
    """Energies in joule; errors relative to the largest energy that the scene has held, kinetic and potential counted
    each without sign. The last of a rendering are those at its last sample, as in the last row of its trace."""

    initial: float
    final: float
    supplied: float
    dissipated: float
    error_max: float
    error_per_step_max: float


def energy_statistics(balance: np.ndarray, energy_totals: np.ndarray) -> EnergyStatistics:
    """The energies of what was rendered. balance: see Balance; energy_totals: State.energy_totals, as
    `find_energy_totals` gives them"""
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


def find_energy_totals(model: Model, state: State, frame: int) -> np.ndarray:
    """Return State.energy_totals as they are before the step of a frame, to which all is rendered. An island that flies
    free is counted up to the end of its flight in them; here it is taken there from the begin, by single steps."""
    flight, totals = state.flight, state.energy_totals.copy()
    end = flight.frame[:, FlightFrame.END]
    flying = np.flatnonzero((end - FLIGHT_FRAMES < frame) & (frame < end))
    if not flying.size:
        return totals
    has_weight = bool(model.effects & WEIGHT)
    step, lost = map_of_step(model.step, has_weight=has_weight)
    for n in flying:
        modes = slice(*model.islands.mode[n : n + 2])
        motion = np.array([flight.q[modes], flight.p[modes], *([model.weight[modes]] if has_weight else [])])
        totals[n] = flight.energy_totals[n]
        with np.errstate(all="ignore"):  # of what has blown up
            for _ in range(flight.frame[n, FlightFrame.SAVED], frame):
                totals[n, EnergyTotal.DISSIPATED] += np.einsum("im,ijm,jm->", motion, lost[..., modes], motion)
                motion[:2] = np.einsum("ijm,jm->im", step.high[:2, :, modes], motion)
    return totals
