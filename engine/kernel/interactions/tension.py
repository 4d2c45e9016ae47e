"""Tension that rises as a body stretches: of strings (Kirchhoff-Carrier), and of membranes and plates (Berger).

The potential is V = ¼·K·s², with the stretch s = Σ κ·q². Over a step its discrete gradient pushes each mode by

    F = -λ·κ·(q + q⁺)/2,    λ = ½·K·(s + s⁺),

whose work is -ΔV. With the momentum of the drift without it, x = q + ½·v·p, and a = ½·t·v·κ:

    q⁺ = 2·x/(1 + a·λ) - q,    so that one number for each body is to be found:  λ = ½·K·(s + s⁺(λ)).

It has one solution, also where contacts push (docs/design.md, "Bodies that stretch").
"""

import math

from engine.compiler.decorators import TRUE, inline, noinline
from engine.compiler.lanes import number_at, place_after, put_number, splat
from engine.kernel.data.enums import EnergyTotal
from engine.kernel.modes.ordered_sums import accumulate, fold, fold_lanes
from engine.kernel.modes.potential import add_elastic

MAX_PASSES = 200  # over the modes, to find a tension; two or three are usual
ROUNDING = 1e-16  # of the tension: what is left out is less
ROOT_STEPS = 4  # of Newton's method on the polynomial of a pass


@inline
def stretches(tension, state):
    """True if a body of the island stretches now."""
    if tension is None:
        return False
    return state.tension.is_active[0] != 0


# --- the tension is found


@inline
def add_stretch_sums(of, k, sums):
    """Add to the sums, of mode k of a body: its stretch at the begin of the step; and that at the end by powers of the
    change of the tension."""
    tension, h, state, first, rise = of
    m = place_after(k, first)
    q, drift, weight = number_at(state.q, m), number_at(h.drift, m), number_at(tension.weight, m)
    x = q + 0.5 * drift * number_at(state.drift_momentum, m)
    compliance = 0.5 * number_at(h.kick, m) * drift * weight
    share = 1.0 / (1.0 + compliance * rise)
    y, softness = x * share, compliance * share
    end, weighted = 2.0 * y - q, weight * y * softness
    c2 = weighted * softness
    return (
        sums[0] + weight * q * q,
        sums[1] + weight * end * end,
        sums[2] - 4.0 * weighted * end,
        sums[3] + 4.0 * c2 * (3.0 * y - q),
        sums[4] - 4.0 * c2 * softness * (4.0 * y - q),
    )


@inline
def solve_polynomial(rise, half_stiffness, sums):
    """Return the change δ of a tension with rise + δ = ½K·(s + c0 + c1·δ + c2·δ² + c3·δ³), N or N/m. sums: s and c"""
    s, c0, c1, c2, c3 = sums
    change = 0.0
    for _ in range(ROOT_STEPS):
        residual = (rise + change) - half_stiffness * (s + c0 + change * (c1 + change * (c2 + change * c3)))
        slope = 1.0 - half_stiffness * (c1 + change * (2.0 * c2 + 3.0 * change * c3))
        step = residual / slope if slope > 0.0 else 0.0
        change -= step
        if abs(step) <= ROUNDING * rise:
            break
    return change


@inline
def stretch_by_ends(tension, extension, b):
    """Return what the ends of string b stretch it, m, beyond what its modes do."""
    ends, weights, stretch = tension.ends[b], tension.end_weights[b], 0.0
    for e in range(2):
        if ends[2 * e] >= 0:
            y = extension[ends[2 * e + 1]]
            stretch += weights[e] * y * (2.0 * extension[ends[2 * e]] + y)
    if ends[0] >= 0 and ends[2] >= 0:
        stretch += 2.0 * weights[2] * extension[ends[1]] * extension[ends[3]]
    return stretch


@noinline
def find_rise(tension, h, state, b, rise):
    """Return the rise of the tension of body b over the coming drift, with all other forces; N, or N/m of a sheet.

    rise: a guess
    """
    first, modes = tension.mode_begin[b], tension.mode_end[b] - tension.mode_begin[b]
    of_ends = state.tension.stretch_of_ends[b]
    half, low, high = 0.5 * state.tension.stiffness[b], 0.0, math.inf
    for _ in range(MAX_PASSES):
        zeros = splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        sums = fold(add_stretch_sums, (tension, h, state, first, rise), modes, zeros)
        sums = sums[0] + of_ends[0], sums[1] + of_ends[1], sums[2], sums[3], sums[4]
        if rise > half * (sums[0] + sums[1]):
            high = min(high, rise)
        else:
            low = max(low, rise)
        change = solve_polynomial(rise, half, sums)
        following = rise + change
        if abs(change) <= 10.0 * ROUNDING * rise:
            return following
        if low <= following and following <= high:
            cut = half * abs(sums[4] * change * change * change) * abs(change) * tension.softest[b]
            if cut <= ROUNDING * following:
                return following
        elif high < math.inf:
            following = 0.5 * (low + high)
        else:
            following = 2.0 * rise + half * sums[0]
        rise = following
    return rise


@inline
def find_free_rises(tension, h, state):
    """Find the rise of the tension of each body, with all forces that have pushed so far."""
    for b in range(tension.mode_begin.shape[0]):
        if state.tension.stiffness[b] != 0.0:
            state.tension.rise[b] = find_rise(tension, h, state, b, predicted_rise(state.tension.history[b]))


@inline
def predict_rises(tension_state):
    """Predict the rise of the tension of each body from the last steps."""
    for b in range(tension_state.rise.shape[0]):
        if tension_state.stiffness[b] != 0.0:
            tension_state.rise[b] = predicted_rise(tension_state.history[b])


@inline
def predicted_rise(history):
    """Return the tension that goes on as in the last three steps."""
    return max(0.0, 3.0 * (history[0] - history[1]) + history[2])


# --- and pushes


@inline
def add_push_of_stretch(of, k, sums):
    """Do half a kick on mode k of a body by the rise of its tension, and keep it for the second half."""
    tension, h, state, first, rise = of
    m = place_after(k, first)
    kick, drift, weight = number_at(h.kick, m), number_at(h.drift, m), number_at(tension.weight, m)
    momentum = number_at(state.drift_momentum, m)
    x = number_at(state.q, m) + 0.5 * drift * momentum
    change = kick * weight * rise * x / (1.0 + 0.5 * kick * drift * weight * rise)
    put_number(state.drift_momentum, m, momentum - change)
    put_number(state.push, m, number_at(state.push, m) - change)
    return sums


@inline
def push_by_tension(tension, h, state):
    """Do half a kick by the rise of the tension of each body, and keep it for the second half."""
    for b in range(tension.mode_begin.shape[0]):
        rise = state.tension.rise[b]
        if rise != 0.0:
            first, modes = tension.mode_begin[b], tension.mode_end[b] - tension.mode_begin[b]
            fold_lanes(add_push_of_stretch, (tension, h, state, first, rise), modes, (splat(0.0),))


@inline
def remember_rises(tension_state):
    """Keep the rises of this step to predict those of the next."""
    for b in range(tension_state.rise.shape[0]):
        history = tension_state.history[b]
        history[2], history[1], history[0] = history[1], history[0], tension_state.rise[b]


# --- energy


@inline
def add_stretch(of, k, sums):
    """Add what mode k of a body stretches it, and p² + ω²q² of the mode, to the sums."""
    tension, omega_squared, state, first = of
    m = place_after(k, first)
    q, p = number_at(state.q, m), number_at(state.p, m)
    return sums[0] + number_at(tension.weight, m) * q * q, sums[1] + add_elastic(omega_squared, m, q, p * p)


@inline
def add_stretch_by_ends(tension, connection_state, b, stretch):
    """Return a stretch with that by the ends of string b. connection_state: ConnectionState or None"""
    if connection_state is not None:
        if connection_state.extension.shape[0] > 0:
            return stretch + stretch_by_ends(tension, connection_state.extension, b)
    return stretch


@noinline
def energies_of_body(tension, omega_squared, state, b):
    """Return the energy of the stretch of body b, and that of its modes, J."""
    of = tension, omega_squared, state, tension.mode_begin[b]
    stretch, vibration = fold(add_stretch, of, tension.mode_end[b] - tension.mode_begin[b], (splat(0.0), splat(0.0)))
    stretch = add_stretch_by_ends(tension, state.connection, b, stretch)
    return 0.25 * state.tension.stiffness[b] * stretch * stretch, 0.5 * vibration


@inline
def stretching_energy(tension, omega_squared, state):
    """Energy that bodies hold because they are stretched, J."""
    total = 0.0
    if tension is not None:
        if stretches(tension, state):
            total = sum_stretching_energies(tension, omega_squared, state)
    return total


@noinline
def sum_stretching_energies(tension, omega_squared, state):
    """Return the sum of the energies of the stretch of all bodies of an island, J."""
    total = 0.0
    for b in range(tension.mode_begin.shape[0]):
        if state.tension.stiffness[b] != 0.0:
            total += energies_of_body(tension, omega_squared, state, b)[0]
    return total


# --- bodies whose tension hardly rises are linear


@inline
def update_stretching(tension, model, state):
    """Let the bodies of an island stretch if the rise of the tension of one may be heard, else be linear."""
    if tension is not None:
        if tension.can_stretch[0] != 0:
            set_stretching(tension, model.omega_squared, is_any_loud(tension, model.omega_squared, state), state)


@inline
def let_stretch(tension, model, state):
    """Let the bodies of an island stretch, as something may act on them."""
    if tension is not None:
        if tension.can_stretch[0] != 0:
            set_stretching(tension, model.omega_squared, TRUE, state)


@noinline
def is_any_loud(tension, omega_squared, state):
    """True if the energy of a body may raise its pitch by more than the scene lets pass."""
    for b in range(tension.mode_begin.shape[0]):
        stiffness = state.tension.stiffness[b]
        if stiffness != 0.0:
            stretch, vibration = energies_of_body(tension, omega_squared, state, b)
            if not stiffness * (stretch + vibration) <= tension.unheard[b]:
                return True
    return False


@inline
def set_stretching(tension, omega_squared, is_active, state):
    """Let bodies stretch or be linear. The energy of the stretch is supplied or dissipated."""
    if is_active != stretches(tension, state):
        state.tension.is_active[0] = 1
        energy = sum_stretching_energies(tension, omega_squared, state)
        accumulate(state.energy_totals, EnergyTotal.SUPPLIED if is_active else EnergyTotal.DISSIPATED, energy)
        state.tension.is_active[0] = 1 if is_active else 0
