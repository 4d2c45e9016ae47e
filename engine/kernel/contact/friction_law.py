"""The law of friction at a point: a bristle of stiffness k and damping c between two surfaces, which bends by z and
slips where it would push harder than the normal force allows (docs/design.md, "Friction").

    F = clip(k·z + K·Δ, ±F_max),    z⁺ = z + (F - k·z)/K, within ±F_max/k,
    K = θ·k + c/h,    θ = max(½, 1 - 1/(B·k) - c/(h·k))

with Δ = η the slip of the surfaces in a step of length h, and F_max known before it is solved. F never falls with η, so
that the law is solved with those of contacts, of which each is such a law too. It contains Coulomb's as k → ∞, and
creates no energy: the work F·Δ is at least what the bristle gains, ½k(z⁺² - z²). The force of a point that sticks is
the mean over the step, unless it would then alternate from step to step.
"""

import math

from engine.compiler.decorators import inline
from engine.kernel.contact.friction_coefficient import share_forgotten
from engine.kernel.data.effects import EFFECTS, FRICTION
from engine.kernel.data.enums import Sliding, SolveStatus

SAME_FORCE = 1e-14  # share by which forces differ that are the same but for rounding
STICKING = 1.0 - 1e-12  # share of the largest force: with less, surfaces do not slip


@inline
def slides(friction, k):
    """True if item k of the contacts is a point of friction. friction: State.law_numbers"""
    if EFFECTS & FRICTION:
        return friction[k][Sliding.BRISTLE] > 0.0
    return False


@inline
def surface_move(friction, duration, k):
    """Return how far the surface of point k moves by itself in a step, m: that of a bow; 0 of a contact."""
    if slides(friction, k):
        return friction[k][Sliding.VELOCITY] * duration[k]
    return 0.0


@inline
def force_may_act(friction, k, z):
    """True if point of friction k may have a force in this step: surfaces are pressed, or its bristle is bent. A force
    that an event has set since the last step counts, too."""
    return friction[k][Sliding.PRESS] > 0.0 or friction[k][Sliding.FORCE] > 0.0 or z != 0.0


@inline
def solve_friction(friction, k, z, g, compliance):
    """Solve for the slip η at point k in a step with η + B·F(η) = g, in closed form.

    z: how far the bristle is bent, m; g: the slip without friction, m; compliance: B, m/N

    Returns η (m), the end of the bristle (m), F (N), dF/dη (N/m), 0 evaluations of the law, and SolveStatus.
    """
    slope, most = friction[k][Sliding.SLOPE], friction[k][Sliding.BOUND]
    f = force_of_sticking(friction[k], z, g, compliance)
    eta = (g - compliance * friction[k][Sliding.BRISTLE] * z) / (1.0 + compliance * slope)
    if not abs(f) <= most:  # NaN is clipped, and found by others
        f, slope = math.copysign(most, f), 0.0
        eta = g - compliance * f
    return eta, end_of_bristle(friction[k], z, eta, f), f, slope, 0, SolveStatus.CLOSED_FORM


@inline
def force_of_sticking(point, z, g, compliance):
    """Return the force at a point that does not slip in a step, N. g: the slip without friction, m"""
    slope = point[Sliding.SLOPE]
    return (point[Sliding.BRISTLE] * z + slope * g) / (1.0 + compliance * slope)


@inline
def end_of_bristle(point, z, eta, f):
    """Return how far the bristle is bent at the end of a step, m. z: at its start, m; η: slip, m; F: force, N"""
    stiffness, most = point[Sliding.BRISTLE], point[Sliding.BOUND]
    bent = eta if abs(f) < STICKING * most else (f - stiffness * z) / point[Sliding.SLOPE]
    return min(max(z + bent, -most / stiffness), most / stiffness)


@inline
def slope_of_sticking(stiffness, damping, compliance, duration):
    """Return K, N/m: of the mean over a step, or so much more that the bristle does not alternate.

    stiffness: k, N/m; damping: c, kg/s; compliance: B, m/N; duration: h, s
    """
    slope = 0.5 * stiffness + damping / duration
    if compliance > 0.0:
        slope = max(slope, stiffness - 1.0 / compliance)
    return slope


@inline
def respond_by_friction(friction, k, z, eta):
    """Return F at point k, N, and its slope dF/dη, N/m, for a slip η."""
    slope, most = friction[k][Sliding.SLOPE], friction[k][Sliding.BOUND]
    f = friction[k][Sliding.BRISTLE] * z + slope * eta
    if abs(f) <= most:
        return f, slope
    return math.copysign(most, f), 0.0


@inline
def is_on_law(friction, k, z, eta, f):
    """True if F is the force at point k for a slip η, but for rounding: after a move along its tangent, the point is
    still stuck, or slides the same way."""
    size = abs(f) + friction[k][Sliding.BRISTLE] * abs(z) + friction[k][Sliding.SLOPE] * abs(eta)
    return abs(respond_by_friction(friction, k, z, eta)[0] - f) <= SAME_FORCE * size


@inline
def bristle_energy(friction, k, z):
    """Energy of the bristle at point k, J."""
    return 0.5 * friction[k][Sliding.BRISTLE] * z * z


@inline
def store_friction(state, k, duration, solution, residual):
    """Store the bristle, slip and force of point k after a step. Returns the energy lost, J.

    solution: slip (m), compression at the end, and force (N), …; residual: how much further the surfaces slipped, m
    """
    point, eta, f = state.law_numbers[k], solution[0], solution[2]
    before, end = state.compression[k], end_of_bristle(point, state.compression[k], eta, f)
    bent = eta if end == before + eta else end - before
    slip = (eta - bent) + residual  # what the bristle gave way
    state.compression[k], state.compression_compensation[k], state.contact_force[k] = end, 0.0, f
    speed = slip / duration if end != before + eta else 0.0
    remembered = point[Sliding.REMEMBERED_SPEED]
    remembered += (abs(speed) - remembered) * share_forgotten(point[Sliding.MEMORY], duration)
    point[Sliding.SLIP], point[Sliding.REMEMBERED_SPEED] = speed, remembered
    return f * slip + bent * (f - point[Sliding.BRISTLE] * (before + 0.5 * bent))
