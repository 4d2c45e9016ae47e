"""Energies of modes, and from these bounds of how far they can move in a while in which nothing acts."""

import math

from engine.compiler.decorators import inline
from engine.compiler.lanes import (
    multiply_add,
    number_at,
    put_number,
    splat,
)
from engine.kernel.modes.ordered_sums import fold, fold_lanes
from engine.kernel.modes.potential import (
    add_potential,
    bound_by_weight,
    potential_of,
    squared_swing,
    zero_without_spring,
)


@inline
def add_energies(of, m, sums):
    """Add p², ω²q², weight·q and |weight·q| of mode m to these sums."""
    potential, q, p = of
    y = number_at(p, m)
    return multiply_add(y, y, sums[0]), *add_potential(potential, m, number_at(q, m), sums[1:])


@inline
def kinetic_and_potential(model, state):
    """½p², ½ω²q² - weight·q, and ½ω²q² + |weight·q|, summed over modes, J."""
    of, zeros = (potential_of(model), state.q, state.p), splat(0.0)
    kinetic, elastic, fallen, fallen_size = fold(add_energies, of, state.p.shape[0], (zeros, zeros, zeros, zeros))
    return 0.5 * kinetic, 0.5 * elastic - fallen, 0.5 * elastic + fallen_size


# --- vibration, and bounds


@inline
def vibration_squared(potential, m, q, p):
    """A² = p² + ω²·(q - q₀)² of mode m, which swings about q₀, where its weight holds it: twice its energy of
    vibration, J. That of a free mass is p²."""
    return p * p + squared_swing(potential.omega_squared, potential.weight, m, q)


@inline
def bound_mode(of, m, sums):
    """Write how far mode m can move in a flight, √kg·m."""
    (model, state), potential = of, potential_of(of[0])
    q, p = number_at(state.q, m), number_at(state.p, m)
    speed = math.sqrt(vibration_squared(potential, m, q, p))
    bound = speed * number_at(model.flight.bound_per_speed, m)
    put_number(state.displacement_bound, m, bound + bound_by_weight(potential.weight, model.flight, m))
    return sums


@inline
def bound_modal_displacements(model, state):
    """Write how far each mode can move in a flight in which nothing else acts, √kg·m, to `State.displacement_bound`.

    A mode swings with amplitude A/ω and speed A at most; it loses energy, and gains none. A free mass coasts and falls.
    """
    fold_lanes(bound_mode, (model, state), state.p.shape[0], (splat(0.0),))


@inline
def vibration_energy_of(potential, m, q, p):
    """Energy of vibration of mode m, ½A²; 0 of a free mass, J."""
    square = vibration_squared(potential, m, number_at(q, m), number_at(p, m))
    return zero_without_spring(potential.omega_squared, m, 0.5 * square)


@inline
def add_vibration(of, m, sums):
    """Add the energy of vibration of mode m, J, to the sums."""
    potential, q, p = of
    return (sums[0] + vibration_energy_of(potential, m, q, p),)


@inline
def vibration_energy(model, state):
    """Energy of vibration, Σ ½A² of all modes but free masses, J."""
    of = potential_of(model), state.q, state.p
    return fold(add_vibration, of, state.p.shape[0], (splat(0.0),))[0]


@inline
def add_motion(of, m, sums):
    """Add twice the energy of vibration of mode m, or p² of a free mass, J, to the sums."""
    potential, q, p = of
    return (sums[0] + vibration_squared(potential, m, number_at(q, m), number_at(p, m)),)


@inline
def motion_energy(model, state):
    """Energy of vibration of all modes about their rest, and of the motion of free masses, J."""
    of = potential_of(model), state.q, state.p
    return 0.5 * fold(add_motion, of, state.p.shape[0], (splat(0.0),))[0]
