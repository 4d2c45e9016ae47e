"""The law of friction at a point: a bristle of stiffness k between two surfaces, which bends by z and slips where it
would push harder than the normal force allows (docs/design.md, "Friction").

    F = clip(k·(z + θ·Δ), ±F_max),    z⁺ = clip(z + Δ, ±F_max/k),    θ = max(½, 1 - 1/(B·k))

with Δ = η the slip of the surfaces in a step, and F_max known before it. F never falls with η, so that the law is
solved with those of contacts, of which each is such a law too. It contains Coulomb's as k → ∞, and creates no energy:
the work F·Δ is at least what the bristle gains, ½k(z⁺² - z²). The force of a point that sticks is the mean over the
step, unless it would then alternate from step to step.
"""

import math

from engine.compiler.decorators import inline
from engine.kernel.data.enums import Sliding, SolveStatus

SAME_FORCE = 1e-14  # share by which forces differ that are the same but for rounding


@inline
def slides(friction, k):
    """True if item k of the contacts is a point of friction. friction: State.friction or None"""
    if friction is None:
        return False
    return friction[k][Sliding.BRISTLE] > 0.0


@inline
def acts(friction, k, z):
    """True if point of friction k may have a force in this step: surfaces are pressed, or its bristle is bent."""
    if friction is None:
        return False
    return friction[k][Sliding.PRESS] > 0.0 or z != 0.0


@inline
def solve_friction(friction, k, z, g, compliance):
    """Solve for the slip η at point k in a step with η + B·F(η) = g, in closed form.

    z: how far the bristle is bent, m; g: the slip without friction, m; compliance: B, m/N

    Returns η (m), the end of the bristle (m), F (N), dF/dη (N/m), 0 evaluations of the law, and SolveStatus.
    """
    if friction is None:
        return g, z, 0.0, 0.0, 0, SolveStatus.CLOSED_FORM
    stiffness, share, most = friction[k][Sliding.BRISTLE], friction[k][Sliding.SHARE], friction[k][Sliding.BOUND]
    per_scale = 1.0 / (1.0 + compliance * stiffness * share)
    f, slope = stiffness * (z + share * g) * per_scale, stiffness * share
    eta = (g - compliance * stiffness * z) * per_scale
    if not abs(f) <= most:  # NaN is clipped, and found by others
        f, slope = math.copysign(most, f), 0.0
        eta = g - compliance * f
    return eta, end_of_bristle(friction[k], z + eta), f, slope, 0, SolveStatus.CLOSED_FORM


@inline
def end_of_bristle(point, z):
    """Return how far the bristle is bent at the end of a step, m, if it would be bent by z without a limit."""
    limit = point[Sliding.BOUND] / point[Sliding.BRISTLE]
    return min(max(z, -limit), limit)


@inline
def share_of_move(bristle, compliance):
    """Return θ: 1/2, or so much more that the bristle does not alternate. bristle: k, N/m; compliance: B, m/N"""
    return max(0.5, 1.0 - 1.0 / (compliance * bristle)) if compliance > 0.0 else 0.5


@inline
def respond_by_friction(friction, k, z, eta):
    """Return F at point k, N, and its slope dF/dη, N/m, for a slip η."""
    if friction is None:
        return 0.0, 0.0
    stiffness, share, most = friction[k][Sliding.BRISTLE], friction[k][Sliding.SHARE], friction[k][Sliding.BOUND]
    f = stiffness * (z + share * eta)
    if abs(f) <= most:
        return f, stiffness * share
    return math.copysign(most, f), 0.0


@inline
def is_on_law(friction, k, z, eta, f):
    """True if F is the force at point k for a slip η, but for rounding: after a move along its tangent, the point is
    still stuck, or slides the same way."""
    if friction is None:
        return True
    size = abs(f) + friction[k][Sliding.BRISTLE] * abs(eta)
    return abs(respond_by_friction(friction, k, z, eta)[0] - f) <= SAME_FORCE * size


@inline
def bristle_energy(friction, k, z):
    """Energy of the bristle at point k, J."""
    if friction is None:
        return 0.0
    return 0.5 * friction[k][Sliding.BRISTLE] * z * z
