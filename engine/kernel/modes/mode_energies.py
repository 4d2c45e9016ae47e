"""Energies of modes, and from these bounds of how far they can move in a while in which nothing acts."""

import math

from engine.compiler.decorators import INT64_0, inline
from engine.compiler.lanes import (
    EightFrom,
    FewFrom,
    lane_sum,
    magnitude,
    multiply_add,
    number_at,
    put_number,
    splat,
    where_positive,
    zero_like,
)
from engine.kernel.data.enums import LANES
from engine.kernel.modes.ordered_sums import lanes_of


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
def kinetic_and_potential(model, state):
    """½p², ½ω²q² - weight·q, and ½ω²q² + |weight·q|, summed over modes, J."""
    omega_squared, weight, q, p = model.omega_squared, model.weight, state.q, state.p
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


# --- vibration, and bounds


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
def bound_mode(model, weight, m, state):
    """Write how far mode m can move in a flight, √kg·m."""
    q, p = number_at(state.q, m), number_at(state.p, m)
    speed = math.sqrt(vibration_squared(model.omega_squared, weight, m, q, p))
    bound = speed * number_at(model.flight.bound_per_speed, m)
    put_number(state.displacement_bound, m, bound + bound_by_weight(weight, model.flight.bound_per_weight, m))


@inline
def bound_modal_displacements(model, state):
    """Write how far each mode can move in a flight in which nothing else acts, √kg·m, to `State.displacement_bound`.

    A mode swings with amplitude A/ω and speed A at most; it loses energy, and gains none. A free mass coasts and falls.
    """
    modes = state.p.shape[0]
    lanes = lanes_of(modes)
    for m in range(INT64_0, lanes, LANES):
        bound_mode(model, model.weight, EightFrom(m), state)
    if lanes < modes:
        bound_mode(model, model.weight, FewFrom(lanes, modes - lanes), state)


@inline
def vibration_energy_of(omega_squared, weight, m, q, p):
    """Energy of vibration of mode m, ½A²; 0 of a free mass, J."""
    square = vibration_squared(omega_squared, weight, m, number_at(q, m), number_at(p, m))
    return where_positive(number_at(omega_squared, m), 0.5 * square, 0.0)


@inline
def vibration_energy(model, state):
    """Energy of vibration, Σ ½A² of all modes but free masses, J."""
    return sum_vibration_energies(model.omega_squared, model.weight, state.q, state.p)


@inline
def sum_vibration_energies(omega_squared, weight, q, p):
    """Sum the energies of vibration of all modes, J."""
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
