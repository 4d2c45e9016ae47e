"""The energy balance: stored + dissipated - supplied = constant (docs/design.md, sec. 1).

It is measured from the state exactly as for the continuous system (paper, sec. 2.4),
and never changes the scheme.
"""

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import EightFrom, FewFrom, lane_sum, magnitude, multiply_add, number_at, splat, zero_like
from engine.kernel.codes import LANES, EnergyTotal, Ledger
from engine.kernel.connections import connection_energy
from engine.kernel.contacts import contact_energy
from engine.kernel.sums import lanes_of


@inline
def mode_potential(omega_squared, weight, m, q):
    """½ω²q² and weight·q of mode m, or of eight, J."""
    elastic, fallen = zero_like(q), zero_like(q)
    if omega_squared is not None:
        elastic = 0.5 * number_at(omega_squared, m) * q * q
    if weight is not None:
        fallen = number_at(weight, m) * q
    return elastic, fallen


@inline
def add_energies(omega_squared, weight, m, q, p, sums):
    """Add p², ω²q², weight·q and |weight·q| of mode m to these sums."""
    x, y, (kinetic, elastic, fallen, fallen_size) = number_at(q, m), number_at(p, m), sums
    kinetic = multiply_add(y, y, kinetic)
    if omega_squared is not None:
        elastic = multiply_add(number_at(omega_squared, m) * x, x, elastic)
    if weight is not None:
        energy = number_at(weight, m) * x
        fallen, fallen_size = fallen + energy, fallen_size + magnitude(energy)
    return kinetic, elastic, fallen, fallen_size


@inline
def kinetic_and_potential(omega_squared, weight, q, p):
    """½p², ½ω²q² - weight·q, and ½ω²q² + |weight·q|, summed over modes, J."""
    whole, zeros = lanes_of(p.shape[0]), splat(0.0)
    lanes = (zeros, zeros, zeros, zeros)
    for m in range(INT64_0, whole, LANES):
        lanes = add_energies(omega_squared, weight, EightFrom(m), q, p, lanes)
    left = p.shape[0] - whole
    if left > 1:
        lanes = add_energies(omega_squared, weight, FewFrom(whole, left), q, p, lanes)
    sums = (lane_sum(lanes[0]), lane_sum(lanes[1]), lane_sum(lanes[2]), lane_sum(lanes[3]))
    if left == 1:
        sums = add_energies(omega_squared, weight, whole, q, p, sums)
    kinetic, elastic, fallen, fallen_size = sums
    return 0.5 * kinetic, 0.5 * elastic - fallen, 0.5 * elastic + fallen_size


@inline
def accumulate(totals, column, amount):
    """Add an energy to a total of an island. Small amounts on a large sum: rounding is carried (Kahan)."""
    amount += totals[column + 1]
    before = totals[column]
    totals[column] = before + amount
    totals[column + 1] = amount - (totals[column] - before)


@noinline
def island_energy(model, state):
    """Energy of an island, J."""
    kinetic, potential, _ = kinetic_and_potential(model.omega_squared, model.weight, state.q, state.p)
    stored = contact_energy(model.contact, state) + connection_energy(model.connection, state)
    return kinetic + potential + stored


@inline
def island_energies(model, state):
    """The energies of an island, as the rows of a ledger have them, J."""
    kinetic, potential, absolute_potential = kinetic_and_potential(model.omega_squared, model.weight, state.q, state.p)
    squeezed, joined = contact_energy(model.contact, state), connection_energy(model.connection, state)
    spent = state.energy_totals[EnergyTotal.DISSIPATED] - state.energy_totals[EnergyTotal.SUPPLIED]
    # a falling ball holds energy, though its total may be 0; so do two at heights that cancel
    return kinetic + potential + squeezed + joined + spent, kinetic + absolute_potential + squeezed + abs(joined)


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
