"""The law of friction at a point: a bristle of stiffness k between two surfaces, which bends by z and slips where it
would push harder than the normal force allows (docs/design.md, "Friction").

    F = k·z⁺,    z⁺ = clip(z + Δ, ±F_max/k)

with Δ = η the slip of the surfaces in a step, and F_max known before it. F never falls with η, so that the law is
solved with those of contacts, of which each is such a law too. It contains Coulomb's as k → ∞, and creates no energy:
the work F·Δ is at least what the bristle gains, ½k(z⁺² - z²).
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
def solve_friction(point, z, g, compliance):
    """Solve for the slip η of a step with η + B·F(η) = g, in closed form.

    point: row of State.friction; z: how far the bristle is bent, m; g: the slip without friction, m
    compliance: B, m/N

    Returns η (m), the end of the bristle (m), F (N), dF/dη (N/m), 0 evaluations of the law, and SolveStatus.
    """
    k, most = point[Sliding.BRISTLE], point[Sliding.BOUND]
    scale = compliance * k
    f, eta, slope = k * (z + g) / (1.0 + scale), (g - scale * z) / (1.0 + scale), k
    if not abs(f) <= most:  # NaN is clipped, and found by others
        f, slope = math.copysign(most, f), 0.0
        eta = g - compliance * f
    return eta, f / k, f, slope, 0, SolveStatus.CLOSED_FORM


@inline
def respond_by_friction(point, z, eta):
    """Return F, N, and its slope dF/dη, N/m, for a slip η."""
    k, most = point[Sliding.BRISTLE], point[Sliding.BOUND]
    f = k * (z + eta)
    if abs(f) <= most:
        return f, k
    return math.copysign(most, f), 0.0


@inline
def is_force_at(point, z, eta, f):
    """True if F is the force for a slip η, but for rounding: after a move along its tangent, the point is still stuck,
    or slides the same way."""
    return abs(respond_by_friction(point, z, eta)[0] - f) <= SAME_FORCE * (abs(f) + point[Sliding.BRISTLE] * abs(eta))
