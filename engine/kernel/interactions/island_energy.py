"""The energy balance: stored + dissipated - supplied = constant (docs/design.md, sec. 1).

It is measured from the state exactly as for the continuous system (paper, sec. 2.4),
and never changes the scheme.
"""

import math

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import EightFrom, FewFrom, lane_sum, number_at, splat, zero_like
from engine.kernel.data.enums import LANES, EnergyTotal, Ledger
from engine.kernel.interactions.connections import connection_energy, has_connections
from engine.kernel.interactions.contacts import contact_energy
from engine.kernel.modes.mode_energies import kinetic_and_potential, vibration_energy_of
from engine.kernel.modes.ordered_sums import lanes_of


@noinline
def island_energy(model, state):
    """Energy of an island, J."""
    kinetic, potential, _ = kinetic_and_potential(model, state)
    stored = contact_energy(model.contact, state) + connection_energy(model.connection, state)
    return kinetic + potential + stored


@inline
def island_energies(model, state):
    """The energies of an island, as the rows of a ledger have them, J."""
    kinetic, potential, absolute_potential = kinetic_and_potential(model, state)
    squeezed, stretched = contact_energy(model.contact, state), connection_energy(model.connection, state)
    spent = state.energy_totals[EnergyTotal.DISSIPATED] - state.energy_totals[EnergyTotal.SUPPLIED]
    # a falling ball holds energy, though its total may be 0; so do two at heights that cancel
    return kinetic + potential + squeezed + stretched + spent, kinetic + absolute_potential + squeezed + abs(stretched)


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


# --- of what is connected: its modes exchange energy


@inline
def amplitude_of_connected(model, connection, seconds, state):
    """√(2E) of what is connected, √J, E without the energy of weight; at most, for so many seconds."""
    amplitude = 0.0
    if connection is not None:
        if has_connections(connection, state):
            amplitude = connected_amplitude(model, connection, seconds, state)
    return amplitude


@noinline
def connected_amplitude(model, connection, seconds, state):
    """Return √(2E) of what is connected, √J, in an island that has connections; at most, for so many seconds."""
    omega_squared, weight = model.omega_squared, model.weight
    twice, pull, whole = splat(0.0), splat(0.0), lanes_of(state.p.shape[0])
    for m in range(INT64_0, whole, LANES):
        vibration, load = connected_at(connection, omega_squared, weight, EightFrom(m), state)
        twice, pull = twice + vibration, pull + load
    if whole < state.p.shape[0]:
        rest = FewFrom(whole, state.p.shape[0] - whole)
        vibration, load = connected_at(connection, omega_squared, weight, rest, state)
        twice, pull = twice + vibration, pull + load
    energy = lane_sum(twice) + 2.0 * connection_energy(connection, state)
    return math.sqrt(max(energy, 0.0)) + math.sqrt(lane_sum(pull)) * seconds


@inline
def connected_at(connection, omega_squared, weight, m, state):
    """p² + ω²q² of mode m, or of eight, and the square of its weight; 0 if nothing is connected to it."""
    q, p = number_at(state.q, m), number_at(state.p, m)
    share, twice, load = 1.0 - number_at(connection.is_unconnected, m), p * p, zero_like(p)
    if omega_squared is not None:
        twice = twice + number_at(omega_squared, m) * q * q
    if weight is not None:
        load = number_at(weight, m) * number_at(weight, m)
    return share * twice, share * load


@inline
def energy_of_connected(model, connection, state):
    """Energy of vibration of what is connected, J: beyond that of its rest, and beyond what `vibration_energy` counts
    of its modes."""
    energy = 0.0
    if connection is not None:
        if has_connections(connection, state):
            energy = connected_energy(connection, model.omega_squared, model.weight, state)
    return energy


@noinline
def connected_energy(connection, omega_squared, weight, state):
    """Return the energy of vibration of what is connected, J, beyond that of its rest and that of its modes, in an
    island that has connections."""
    energy = connection_energy(connection, state) - state.connection.lowest_energy[0]
    for m in range(state.p.shape[0]):
        if connection.is_unconnected[m] == 0.0:
            energy += 0.5 * state.p[m] * state.p[m]
            if omega_squared is not None:
                energy += 0.5 * omega_squared[m] * state.q[m] * state.q[m]
                energy -= vibration_energy_of(omega_squared, weight, m, state.q, state.p)
            if weight is not None:
                energy -= weight[m] * state.q[m]
    return energy
