"""Bounds of how far modes can move in a while in which nothing acts, from the energy that they have."""

import math

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import (
    EightFrom,
    FewFrom,
    lane_sum,
    magnitude,
    number_at,
    put_number,
    splat,
    where_positive,
    zero_like,
)
from engine.kernel.codes import LANES
from engine.kernel.connections import connection_energy, has_connections
from engine.kernel.sums import lanes_of


@inline
def vibration_squared(omega_squared, weight, m, q, p):
    """A² = p² + ω²·(q - q₀)² of mode m, which swings about q₀, where its weight holds it: twice its energy of
    vibration, J. That of a free mass is p²."""
    if omega_squared is None:
        return p * p
    stiffness, away = number_at(omega_squared, m), q
    if weight is not None:
        away = q - where_positive(stiffness, number_at(weight, m) / stiffness, 0.0)
    return p * p + stiffness * away * away


@inline
def bound_by_weight(weight, per_weight, m):
    """Return how far weight can move mode m meanwhile, √kg·m."""
    limit = number_at(per_weight, m)
    if weight is None:
        return zero_like(limit)
    return magnitude(number_at(weight, m)) * limit


@inline
def bound_mode(omega_squared, weight, per_speed, per_weight, m, q, p):
    """Return how far mode m can move in a while, √kg·m."""
    speed = math.sqrt(vibration_squared(omega_squared, weight, m, number_at(q, m), number_at(p, m)))
    return speed * number_at(per_speed, m) + bound_by_weight(weight, per_weight, m)


@inline
def bound_modal_displacements(omega_squared, weight, per_speed, per_weight, q, p, bound):
    """Write how far each mode can move in a flight in which nothing else acts, √kg·m, to `bound`.

    A mode swings with amplitude A/ω and speed A at most; it loses energy, and gains none. A free mass coasts and falls.
    """
    lanes = lanes_of(p.shape[0])
    for m in range(INT64_0, lanes, LANES):
        put_number(bound, EightFrom(m), bound_mode(omega_squared, weight, per_speed, per_weight, EightFrom(m), q, p))
    if lanes < p.shape[0]:
        rest = FewFrom(lanes, p.shape[0] - lanes)
        put_number(bound, rest, bound_mode(omega_squared, weight, per_speed, per_weight, rest, q, p))


@inline
def vibration_energy_of(omega_squared, weight, m, q, p):
    """Energy of vibration of mode m, ½A²; 0 of a free mass, J."""
    square = vibration_squared(omega_squared, weight, m, number_at(q, m), number_at(p, m))
    return where_positive(number_at(omega_squared, m), 0.5 * square, 0.0)


@inline
def vibration_energy(omega_squared, weight, q, p):
    """Energy of vibration, Σ ½A² of all modes but free masses, J."""
    if omega_squared is None:
        return 0.0
    lanes, total = lanes_of(p.shape[0]), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        total = total + vibration_energy_of(omega_squared, weight, EightFrom(m), q, p)
    left = p.shape[0] - lanes
    if left > 1:
        total = total + vibration_energy_of(omega_squared, weight, FewFrom(lanes, left), q, p)
    energy = lane_sum(total)
    if left == 1:
        energy += vibration_energy_of(omega_squared, weight, lanes, q, p)
    return energy


# --- of what is connected: its modes exchange energy


@inline
def amplitude_of_connected(connection, omega_squared, weight, seconds, state):
    """√(2E) of what is connected, √J, E without the energy of weight; at most, for so many seconds."""
    amplitude = 0.0
    if connection is not None:
        if has_connections(connection, state):
            amplitude = connected_amplitude(connection, omega_squared, weight, seconds, state)
    return amplitude


@noinline
def connected_amplitude(connection, omega_squared, weight, seconds, state):
    """Return √(2E) of what is connected, √J, in an island that has connections; at most, for so many seconds."""
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
def energy_of_connected(connection, omega_squared, weight, state):
    """Energy of vibration of what is connected, J: beyond that of its rest, and beyond what `vibration_energy` counts
    of its modes."""
    energy = 0.0
    if connection is not None:
        if has_connections(connection, state):
            energy = connected_energy(connection, omega_squared, weight, state)
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
