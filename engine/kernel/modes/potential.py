"""Springs and weight of modes: the kicks they give, the energy they hold, and what weight does over a free flight."""

from typing import Any, NamedTuple

from engine.compiler.decorators import inline
from engine.compiler.lanes import (
    load_lanes,
    magnitude,
    multiply_add,
    number_at,
    put_number,
    store_lanes,
    where_positive,
    zero_like,
)
from engine.kernel.data.effects import EFFECTS, SPRINGS, WEIGHT
from engine.kernel.data.enums import FLIGHT_FRAMES, LANES


class Potential(NamedTuple):
    """Springs and weight of modes."""

    omega_squared: Any  # 1/s² [modes]; 0 of free masses
    weight: Any  # √kg·m/s² [modes]


@inline
def potential_of(model):
    """Return the Potential of all modes of a Model."""
    return Potential(model.omega_squared, model.weight)


# --- kicks


@inline
def kick_by_spring(spring_kick, m, q, p):
    """Return the momentum after half a kick by the restoring force."""
    if EFFECTS & SPRINGS:
        return p - number_at(spring_kick, m) * q
    return p


@inline
def kick_by_weight(weight_kick, compensation, m, p):
    """Return the momentum after half a kick by weight: none if weight_kick is None, or compensation has no items.

    The kick is the same at every step, and so would be its rounding: in free fall the energy drifts by 5e-13 in a
    second. The rounding is carried to the next kick instead (Kahan).
    """
    if weight_kick is not None:
        if EFFECTS & WEIGHT:
            if compensation.shape[0] > 0:  # to read zeros there took 1.2 times as long (kalimba)
                push = number_at(weight_kick, m) - number_at(compensation, m)
                moved = p + push
                put_number(compensation, m, (moved - p) - push)
                return moved
    return p


# --- energies


@inline
def add_elastic(omega_squared, m, q, elastic):
    """Add ω²q² of mode m to a sum."""
    if EFFECTS & SPRINGS:
        return multiply_add(number_at(omega_squared, m) * q, q, elastic)
    return elastic


@inline
def add_potential(potential, m, q, sums):
    """Add ω²q², weight·q and |weight·q| of mode m, or of eight, to these sums."""
    elastic, fallen, fallen_size = sums
    energy = number_at(potential.weight, m) * q if EFFECTS & WEIGHT else zero_like(q)
    return add_elastic(potential.omega_squared, m, q, elastic), fallen + energy, fallen_size + magnitude(energy)


@inline
def squared_pull(weight, m):
    """Return the square of the weight of mode m, or of eight."""
    return number_at(weight, m) * number_at(weight, m)


@inline
def squared_swing(omega_squared, weight, m, q):
    """Return ω²·(q - q₀)² of mode m, which swings about q₀, where its weight holds it; 0 of a free mass."""
    stiffness = number_at(omega_squared, m)
    away = q - where_positive(stiffness, number_at(weight, m) / stiffness, 0.0)
    return stiffness * away * away


@inline
def zero_without_spring(omega_squared, m, value):
    """Return a value of mode m, or of eight; 0 of a free mass."""
    return where_positive(number_at(omega_squared, m), value, 0.0)


@inline
def bound_by_weight(weight, flight, m):
    """Return how far weight can move mode m in a free flight, √kg·m. flight: FreeFlight"""
    return magnitude(number_at(weight, m)) * number_at(flight.bound_per_weight, m)


# --- over a free flight; weight: FlightWeight


@inline
def add_fall(weight, m, rest):
    """Return a sum with what weight adds to q of mode m in a flight.

    This is the same in every flight. Added to q by itself it would be rounded the same way every time, and the energy
    of a falling body would drift; so it is part of a sum that differs.
    """
    if EFFECTS & WEIGHT:
        return rest + number_at(weight.q, m)
    return rest


@inline
def push_by_weight(weight, compensation, saved, p):
    """Add what weight gives p over a flight. As `kick_by_weight`, it carries what rounding leaves of the push."""
    if EFFECTS & WEIGHT:
        for m in range(compensation.shape[0]):
            saved.kick_compensation[m] = compensation[m]
            push = weight.p[m] + (weight.p_low[m] - compensation[m])
            moved = p[m] + push
            compensation[m] = (moved - p[m]) - push
            p[m] = moved


@inline
def mode_loss_by_weight(weight, m, q, p):
    """Energy that mode m, or eight, loses over a flight because of weight, J."""
    return number_at(weight.lost_per_q, m) * q + number_at(weight.lost_per_p, m) * p + number_at(weight.lost, m)


@inline
def begin_output(weight, n, output):
    """Begin the samples of pickup n with those of bodies that fall: the rest is added to it."""
    for i in range(0, FLIGHT_FRAMES, LANES):
        store_lanes(output, i, load_lanes(weight.pickup_values[n], i))
