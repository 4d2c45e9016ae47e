"""The energy balance: stored + dissipated - supplied = constant (docs/design.md, sec. 1).

It is measured from the state exactly as for the continuous system (paper, sec. 2.4),
and never changes the scheme.
"""

from engine.compiler.decorators import inline, noinline
from engine.kernel.data.enums import EnergyTotal, Ledger
from engine.kernel.interactions.connected_modes import energy_of_connected
from engine.kernel.interactions.connections import connection_energy
from engine.kernel.interactions.contacts import contact_energy
from engine.kernel.interactions.tension import stretching_energy
from engine.kernel.modes.mode_energies import kinetic_and_potential, vibration_energy


@noinline
def island_energy(model, state):
    """Energy of an island, J."""
    kinetic, potential, _ = kinetic_and_potential(model, state)
    stored = contact_energy(state) + connection_energy(model.connection, state)
    return kinetic + potential + stored + stretching_energy(model, state)


@inline
def island_energies(model, state):
    """The energies of an island, as the rows of a ledger have them, J."""
    kinetic, potential, absolute_potential = kinetic_and_potential(model, state)
    squeezed, stretched = contact_energy(state), connection_energy(model.connection, state)
    taut = stretching_energy(model, state)
    spent = state.energy_totals[EnergyTotal.DISSIPATED] - state.energy_totals[EnergyTotal.SUPPLIED]
    # a falling ball holds energy, though its total may be 0; so do two at heights that cancel
    absolute = kinetic + absolute_potential + squeezed + abs(stretched) + taut
    return kinetic + potential + squeezed + stretched + taut + spent, absolute


@inline
def energy_of_vibration(model, state):
    """Energy of vibration, J, beyond that of the rest."""
    return vibration_energy(model, state) + energy_of_connected(model, state)


@inline
def write_ledger(ledger, begin, count, is_first, energies):
    """Write an island's energies of `count` samples from sample `begin` on; all but the first island add."""
    balance, absolute = energies
    write_row(ledger[Ledger.BALANCE], begin, count, is_first, balance)
    write_row(ledger[Ledger.ABSOLUTE], begin, count, is_first, absolute)


@inline
def write_row(row, begin, count, is_first, energy):
    """Write or add the same energy to numbers of a row."""
    if is_first:
        for i in range(begin, begin + count):
            row[i] = energy
    else:
        for i in range(begin, begin + count):
            row[i] += energy
