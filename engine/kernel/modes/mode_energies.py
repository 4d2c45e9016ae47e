"""Energies of modes, and from these bounds of how far they can move in a while in which nothing acts."""

import math

from engine.compiler.decorators import inline
from engine.compiler.lanes import (
    magnitude,
    multiply_add,
    number_at,
    put_number,
    splat,
    where_positive,
    zero_like,
)
from engine.kernel.modes.ordered_sums import fold, fold_lanes


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
def add_energies(of, m, sums):
    """Add p², ω²q², weight·q and |weight·q| of mode m to these sums."""
    omega_squared, weight, q, p = of
    x, y, (kinetic, elastic, fallen, fallen_size) = number_at(q, m), number_at(p, m), sums
    fallen, fallen_size = add_fallen(weight, m, x, fallen, fallen_size)
    return multiply_add(y, y, kinetic), add_elastic(omega_squared, m, x, elastic), fallen, fallen_size


@inline
def add_elastic(omega_squared, m, x, elastic):
    """Add ω²q² of mode m to a sum."""
    if omega_squared is None:
        return elastic
    return multiply_add(number_at(omega_squared, m) * x, x, elastic)


@inline
def add_fallen(weight, m, x, fallen, fallen_size):
    """Add weight·q and |weight·q| of mode m to sums."""
    if weight is None:
        return fallen, fallen_size
    energy = number_at(weight, m) * x
    return fallen + energy, fallen_size + magnitude(energy)


@inline
def kinetic_and_potential(model, state):
    """½p², ½ω²q² - weight·q, and ½ω²q² + |weight·q|, summed over modes, J."""
    of, zeros = (model.omega_squared, model.weight, state.q, state.p), splat(0.0)
    kinetic, elastic, fallen, fallen_size = fold(add_energies, of, state.p.shape[0], (zeros, zeros, zeros, zeros))
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
def bound_mode(of, m, sums):
    """Write how far mode m can move in a flight, √kg·m."""
    (model, state), weight = of, of[0].weight
    q, p = number_at(state.q, m), number_at(state.p, m)
    speed = math.sqrt(vibration_squared(model.omega_squared, weight, m, q, p))
    bound = speed * number_at(model.flight.bound_per_speed, m)
    put_number(state.displacement_bound, m, bound + bound_by_weight(weight, model.flight.bound_per_weight, m))
    return sums


@inline
def bound_modal_displacements(model, state):
    """Write how far each mode can move in a flight in which nothing else acts, √kg·m, to `State.displacement_bound`.

    A mode swings with amplitude A/ω and speed A at most; it loses energy, and gains none. A free mass coasts and falls.
    """
    fold_lanes(bound_mode, (model, state), state.p.shape[0], (splat(0.0),))


@inline
def vibration_energy_of(omega_squared, weight, m, q, p):
    """Energy of vibration of mode m, ½A²; 0 of a free mass, J."""
    square = vibration_squared(omega_squared, weight, m, number_at(q, m), number_at(p, m))
    return where_positive(number_at(omega_squared, m), 0.5 * square, 0.0)


@inline
def add_vibration(of, m, sums):
    """Add the energy of vibration of mode m, J, to the sums."""
    omega_squared, weight, q, p = of
    return (sums[0] + vibration_energy_of(omega_squared, weight, m, q, p),)


@inline
def vibration_energy(model, state):
    """Energy of vibration, Σ ½A² of all modes but free masses, J."""
    return sum_vibration_energies(model.omega_squared, model.weight, state.q, state.p)


@inline
def sum_vibration_energies(omega_squared, weight, q, p):
    """Sum the energies of vibration of all modes, J."""
    if omega_squared is None:
        return 0.0
    return fold(add_vibration, (omega_squared, weight, q, p), p.shape[0], (splat(0.0),))[0]
