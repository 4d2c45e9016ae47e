"""The energy balance: stored + dissipated - supplied = constant (docs/design.md, sec. 1).

It is measured from the state exactly as for the continuous system (paper, sec. 2.4),
and never changes the scheme.
"""

from engine.compiler.decorators import inline, reduction
from engine.kernel.codes import EnergyTotal, Ledger
from engine.kernel.contacts import contact_energy


@inline
def mode_potential(omega_squared, weight, m, q):
    """½ω²q² and weight·q of mode m, J."""
    elastic, fallen = 0.0, 0.0
    if omega_squared is not None:
        elastic = 0.5 * omega_squared[m] * q * q
    if weight is not None:
        fallen = weight[m] * q
    return elastic, fallen


@reduction
def kinetic_and_potential(omega_squared, weight, q, p):
    """½p², ½ω²q² - weight·q, and ½ω²q² + |weight·q|, summed over modes, J."""
    kinetic, potential, absolute = 0.0, 0.0, 0.0
    for m in range(p.shape[0]):
        elastic, fallen = mode_potential(omega_squared, weight, m, q[m])
        kinetic += 0.5 * p[m] * p[m]
        potential += elastic - fallen
        absolute += elastic + abs(fallen)
    return kinetic, potential, absolute


@inline
def accumulate(totals, column, amount):
    """Add an energy to a total of an island. Small amounts on a large sum: rounding is carried (Kahan)."""
    amount += totals[column + 1]
    before = totals[column]
    totals[column] = before + amount
    totals[column + 1] = amount - (totals[column] - before)


@inline
def island_energies(model, state):
    """The energies of an island, as the rows of a ledger have them, J."""
    kinetic, potential, absolute_potential = kinetic_and_potential(model.omega_squared, model.weight, state.q, state.p)
    squeezed = contact_energy(model.contact, state)
    spent = state.energy_totals[EnergyTotal.DISSIPATED] - state.energy_totals[EnergyTotal.SUPPLIED]
    # a falling ball holds energy, though its total may be 0; so do two at heights that cancel
    return kinetic + potential + squeezed + spent, kinetic + absolute_potential + squeezed


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
