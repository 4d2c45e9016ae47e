"""Tension that rises as a body stretches: of strings (Kirchhoff-Carrier), and of membranes and plates (Berger).

The potential is V = ¼·K·s², with the stretch s = Σ κ·q². Over a step its discrete gradient pushes each mode by

    F = -λ·κ·(q + q⁺)/2,    λ = ½·K·(s + s⁺),

whose work is -ΔV. With the momentum of the drift without it, x = q + ½·v·p, and a = ½·t·v·κ:

    q⁺ = 2·x/(1 + a·λ) - q,    so that one number for each body is to be found:  λ = ½·K·(s + s⁺(λ)).

It has one solution, also where contacts push (docs/design.md, "Bodies that stretch").
"""

import math
from typing import Any, NamedTuple

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import multiply_add, number_at, place_after, put_number, splat
from engine.kernel.data.effects import EFFECTS, STRETCHING
from engine.kernel.data.enums import MovingEnd, Stretch, StretchFactor
from engine.kernel.interactions.connections import has_connections
from engine.kernel.modes.ordered_sums import fold, fold_lanes
from engine.kernel.modes.potential import add_elastic

MAX_PASSES = 200  # over the modes, to find a tension; two or three are usual
ROUNDING = 1e-16  # of the tension: what is left out is less
NEAR = 1e-5  # change of a tension, times the largest a: its third power is rounding
ROOT_STEPS = 4  # of Newton's method on the polynomial of a pass


@inline
def stretches(state):
    """True if a body of the island stretches now."""
    if EFFECTS & STRETCHING:
        return state.tension.is_active[0] != 0
    return False


@inline
def stiffness_of(tension, b):
    """Return K of body b; 0 if it cannot stretch."""
    return tension.factor[b][StretchFactor.STIFFNESS]


@inline
def present_stiffness(tension, state, b):
    """Return K of body b; 0 if it does not stretch now."""
    return stiffness_of(tension, b) * state.tension.body[b][Stretch.STRETCHES]


# --- the tension is found


class StretchingModes(NamedTuple):
    """Modes of a body that stretches, in the coming drift."""

    kick: Any  # t and v of StepCoefficients
    drift: Any
    kappa: Any  # κ
    q: Any
    momentum: Any  # of the drift
    first: int
    size: int
    push_per_rise: Any  # memory: of a mode in half a kick, √kg·m/s per N
    decline_per_rise: Any  # memory, 1/N: the share by which it moves less, a/(1 + a·λ)


@inline
def modes_of_body(tension, h, state, b):
    """Return the StretchingModes of body b."""
    begin, end = tension.mode_begin[b], tension.mode_end[b]
    memory = state.tension.push_per_rise, state.tension.decline_per_rise
    return StretchingModes(h.kick, h.drift, tension.kappa, state.q, state.drift_momentum, begin, end - begin, *memory)


@inline
def add_stretch_sums(of, k, sums):
    """Add to the sums, of mode k of a body: its stretch at the begin of the step; and that at the end by powers of the
    change of the tension, the odd ones with the other sign, and all but the first over four. Write what the tension
    pushes the mode by in half a kick, and the share by which it moves less, per tension."""
    modes, rise = of
    m = place_after(k, modes.first)
    q, kappa, kick = number_at(modes.q, m), number_at(modes.kappa, m), number_at(modes.kick, m)
    half = 0.5 * number_at(modes.drift, m)
    compliance = kick * half * kappa
    share = 1.0 / multiply_add(compliance, rise, 1.0)
    y, decline_per_rise = multiply_add(half, number_at(modes.momentum, m), q) * share, compliance * share
    end, pull = (y - q) + y, kappa * y
    put_number(modes.push_per_rise, m, kick * pull)
    put_number(modes.decline_per_rise, m, decline_per_rise)
    c1, beyond = pull * decline_per_rise, end + y
    c2 = c1 * decline_per_rise
    return (
        multiply_add(kappa * q, q, sums[0]),
        multiply_add(kappa * end, end, sums[1]),
        multiply_add(c1, end, sums[2]),
        multiply_add(c2, beyond, sums[3]),
        multiply_add(c2 * decline_per_rise, beyond + y, sums[4]),
    )


@inline
def series_of_stretch(sums, ends):
    """Return the stretch at the begin of a step, and the coefficients of that at its end, from the sums over the modes.
    ends: what ends add to both"""
    return sums[0] + ends[0], sums[1] + ends[1], -4.0 * sums[2], 4.0 * sums[3], -4.0 * sums[4]


@inline
def solve_polynomial(rise, half_stiffness, sums):
    """Return the change δ of a tension with rise + δ = ½K·(s + c0 + c1·δ + c2·δ² + c3·δ³), N or N/m; -∞ if Newton's
    method does not lead to it. sums: s and c"""
    s, c0, c1, c2, c3 = sums
    change = 0.0
    for _ in range(ROOT_STEPS):
        residual = (rise + change) - half_stiffness * (s + c0 + change * (c1 + change * (c2 + change * c3)))
        slope = 1.0 - half_stiffness * (c1 + change * (2.0 * c2 + 3.0 * change * c3))
        if not slope > 0.0:
            return -math.inf
        step = residual / slope
        change -= step
        if abs(step) <= ROUNDING * rise:
            break
    return change


@inline
def find_rise(tension, h, state, b, rise):
    """Return the rise of the tension of body b over the coming drift, with all other forces, N, or N/m of a sheet; and
    that of the last pass over its modes.

    rise: a guess
    """
    body, modes = state.tension.body[b], modes_of_body(tension, h, state, b)
    ends = body[Stretch.ENDS_BEFORE], body[Stretch.ENDS_AFTER]
    softest = tension.factor[b][StretchFactor.SOFTEST]
    return solve_rise(modes, 0.5 * present_stiffness(tension, state, b), softest, ends, rise)


@noinline
def solve_rise(modes, half, softest, ends, rise):
    """Return the root λ of λ = ½K·(s + s⁺(λ)), and the tension of the last pass.

    half: ½K; softest: StretchFactor.SOFTEST
    ends: what ends add to s and to s⁺
    rise: a guess
    """
    low, high = 0.0, math.inf
    for _ in range(MAX_PASSES):
        zeros = splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        sums = series_of_stretch(fold(add_stretch_sums, (modes, rise), modes.size, zeros), ends)
        if rise > half * (sums[0] + sums[1]):
            high = min(high, rise)
        else:
            low = max(low, rise)
        change = solve_polynomial(rise, half, sums)
        following = rise + change
        if abs(change) <= 10.0 * ROUNDING * rise:
            return following, rise
        if low <= following and following <= high:
            cut = half * abs(sums[4] * change * change * change) * abs(change) * softest
            if cut <= ROUNDING * following:
                return following, rise
        elif high < math.inf:
            following = 0.5 * (low + high)
        else:
            following = 2.0 * rise + half * sums[0]
        rise = following
    return rise, math.inf


@inline
def find_free_rises(tension, h, state):
    """Find the rise of the tension of each body, with all forces that have pushed so far."""
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        if present_stiffness(tension, state, b) != 0.0:
            body[Stretch.RISE], body[Stretch.TRIED] = find_rise(tension, h, state, b, predicted_rise(body))


@inline
def predict_rises(tension, state):
    """Predict the rise of the tension of each body from the last steps."""
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        if present_stiffness(tension, state, b) != 0.0:
            body[Stretch.RISE] = predicted_rise(body)


@inline
def predicted_rise(body):
    """Return the tension that goes on as in the last three steps."""
    return max(0.0, 3.0 * (body[Stretch.LAST] - body[Stretch.SECOND_LAST]) + body[Stretch.THIRD_LAST])


@inline
def remember_rises(tension, state):
    """Keep the rises of this step to predict those of the next."""
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        body[Stretch.THIRD_LAST], body[Stretch.SECOND_LAST] = body[Stretch.SECOND_LAST], body[Stretch.LAST]
        body[Stretch.LAST] = body[Stretch.RISE]


# --- and pushes


@inline
def add_push_of_stretch(of, k, sums):
    """Do half a kick on mode k of a body by the rise of its tension, and keep it for the second half."""
    modes, push, rise = of
    m = place_after(k, modes.first)
    kick, drift, kappa = number_at(modes.kick, m), number_at(modes.drift, m), number_at(modes.kappa, m)
    momentum = number_at(modes.momentum, m)
    x = number_at(modes.q, m) + 0.5 * drift * momentum
    change = kick * kappa * rise * x / (1.0 + 0.5 * kick * drift * kappa * rise)
    put_number(modes.momentum, m, momentum - change)
    put_number(push, m, number_at(push, m) - change)
    return sums


@noinline
def push_body(modes, push, rise):
    """Do half a kick by the rise of the tension of a body, and keep it for the second half."""
    fold_lanes(add_push_of_stretch, (modes, push, rise), modes.size, (splat(0.0),))


@inline
def push_by_tension(tension, h, state):
    """Do half a kick by the rise of the tension of each body, and keep it for the second half."""
    for b in range(tension.mode_begin.shape[0]):
        rise = state.tension.body[b][Stretch.RISE]
        if rise != 0.0:
            push_body(modes_of_body(tension, h, state, b), state.push, rise)


@inline
def add_push_near_pass(of, k, sums):
    """Do this from what the last pass has written, for a tension that is larger by a small change."""
    modes, push, rise, change = of
    m = place_after(k, modes.first)
    less = number_at(modes.decline_per_rise, m) * change
    kicked = rise * number_at(modes.push_per_rise, m) * (1.0 - less * (1.0 - less))
    put_number(modes.momentum, m, number_at(modes.momentum, m) - kicked)
    put_number(push, m, number_at(push, m) - kicked)
    return sums


@inline
def push_freely(tension, h, state):
    """Do half a kick by the rise of the tension of each body, as `find_free_rises` has left it."""
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        if body[Stretch.RISE] != 0.0:
            change = body[Stretch.RISE] - body[Stretch.TRIED]
            if abs(change) * tension.factor[b][StretchFactor.SOFTEST] <= NEAR:
                of = modes_of_body(tension, h, state, b), state.push, body[Stretch.RISE], change
                fold_lanes(add_push_near_pass, of, tension.mode_end[b] - tension.mode_begin[b], (splat(0.0),))
            else:
                push_body(modes_of_body(tension, h, state, b), state.push, body[Stretch.RISE])


# --- ends of strings that move


@inline
def stretch_by_ends(tension, connection_state, share, b):
    """Return what the ends of string b stretch it, m, beyond what its modes do; share: 0 at the begin of the step, 1 at
    its end"""
    ends, factor, stretch = tension.ends[b], tension.factor[b], 0.0
    s, move = connection_state.extension, connection_state.move
    first, second = ends[MovingEnd.DISPLACEMENT], ends[MovingEnd.OTHER_DISPLACEMENT]
    if first >= 0:
        slope, y = ends[MovingEnd.SLOPE], s[first] + share * move[first]
        stretch += factor[StretchFactor.END] * y * (2.0 * (s[slope] + share * move[slope]) + y)
        if second >= 0:
            slope, other = ends[MovingEnd.OTHER_SLOPE], s[second] + share * move[second]
            stretch += factor[StretchFactor.OTHER_END] * other * (2.0 * (s[slope] + share * move[slope]) + other)
            stretch += 2.0 * factor[StretchFactor.BOTH_ENDS] * y * other
    return stretch


# --- energy


@inline
def add_stretch(of, k, sums):
    """Add what mode k of a body stretches it, and p² + ω²q² of the mode, to the sums."""
    kappa, omega_squared, q, p, first = of
    m = place_after(k, first)
    x, momentum = number_at(q, m), number_at(p, m)
    return sums[0] + number_at(kappa, m) * x * x, sums[1] + add_elastic(omega_squared, m, x, momentum * momentum)


@noinline
def sum_stretch(kappa, omega_squared, q, p, begin, end):
    """Return Σ κq² and Σ p² + ω²q² of modes of a body."""
    return fold(add_stretch, (kappa, omega_squared, q, p, begin), end - begin, (splat(0.0), splat(0.0)))


@inline
def stretch_and_vibration(tension, omega_squared, state, b):
    """Return the stretch of body b, m or m², and the energy of its modes, J."""
    begin, end = tension.mode_begin[b], tension.mode_end[b]
    stretch, vibration = sum_stretch(tension.kappa, omega_squared, state.q, state.p, begin, end)
    if has_connections(state):
        stretch += stretch_by_ends(tension, state.connection, 0.0, b)
    return stretch, 0.5 * vibration


@inline
def stretching_energy(model, state):
    """Energy that bodies hold because they are stretched, J."""
    if stretches(state):
        return sum_stretching_energies(model.tension, model.omega_squared, state)
    return 0.0


@inline
def sum_stretching_energies(tension, omega_squared, state):
    """Return the sum of the energies of the stretch of all bodies of an island, J."""
    total = 0.0
    for b in range(tension.mode_begin.shape[0]):
        if present_stiffness(tension, state, b) != 0.0:
            stretch, _ = stretch_and_vibration(tension, omega_squared, state, b)
            total += 0.25 * stiffness_of(tension, b) * stretch * stretch
    return total
