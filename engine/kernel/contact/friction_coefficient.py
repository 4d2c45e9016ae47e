"""The coefficient of friction at a point, which falls with the speed of slip (docs/design.md, "Friction").

    μ(θ) = μ_d + (μ_s - μ_d)·φ(θ/v0) + ν·θ,    φ(x) = 1/(1 + x) or e^(-x²),    θ' = (|w| - θ)/τ

θ follows the speed w at which the surfaces slip, with a memory τ; that in the middle of a step counts, and w is that of
the same step: the force N·μ slows the slip, and less slip has a higher coefficient. So several θ may answer to one
motion (Friedlander 1953). The one taken is that to which θ comes from the end of the last step, if it moves on to where
the slip would be under its coefficient, again and again: the nearest in that direction. Any is passive, as the force
opposes the slip.
"""

import math

from engine.compiler.decorators import inline, noinline
from engine.compiler.elementary import expm1_of
from engine.kernel.data.enums import Sliding

SAME_SPEED = 1e-13  # share by which speeds differ that are the same but for rounding
ROUNDS = 200  # at most, of the search for a speed of slip; beyond, the last one counts


@inline
def share_forgotten(memory, duration):
    """Return how much of the way to the present speed of slip the remembered one goes in a duration, 0 to 1."""
    if memory <= 0.0:
        return 1.0
    return -expm1_of(-duration / memory)


@inline
def coefficient_at(point, speed):
    """Return the coefficient of friction at a speed of slip, m/s, and its slope, s/m."""
    at, difference = point[Sliding.SPEED], point[Sliding.STATIC] - point[Sliding.DYNAMIC]
    if point[Sliding.IS_EXPONENTIAL] != 0.0:
        ratio = speed / at
        fall = difference * (1.0 + expm1_of(-ratio * ratio))
        slope = -2.0 * fall * ratio / at
    else:
        fall = difference * (at / (at + speed))
        slope = -fall / (at + speed)
    return point[Sliding.DYNAMIC] + fall + point[Sliding.VISCOUS] * speed, slope + point[Sliding.VISCOUS]


@inline
def choose_coefficient(point, force, compliance, duration):
    """Choose the coefficient of friction in a step, by the slip in it.

    force:      N, if the surfaces did not slip
    compliance: B, m/N, of the bodies; duration: h, s
    """
    share, remembered = share_forgotten(point[Sliding.MEMORY], 0.5 * duration), point[Sliding.REMEMBERED_SPEED]
    least = (1.0 - share) * remembered  # where the speed comes to without slip
    mobility = share * (compliance + 1.0 / point[Sliding.SLOPE]) / duration  # slip by a force less, m/s each N
    goes_on = share < 1.0 or point[Sliding.SLIP] * force > 0.0
    begin = max(remembered, least) if goes_on else least
    curve = least + mobility * abs(force), mobility * point[Sliding.PRESS]
    if point[Sliding.IS_EXPONENTIAL] != 0.0:
        speed = search_speed(point, curve, begin, least)
    else:
        speed = speed_on_hyperbola(point, curve, begin, least)
    point[Sliding.COEFFICIENT] = coefficient_at(point, speed)[0]
    point[Sliding.BOUND] = point[Sliding.PRESS] * point[Sliding.COEFFICIENT]


@inline
def speed_on_hyperbola(point, curve, begin, least):
    """Return the speed θ to which θ comes from `begin`, m/s, where the coefficient is a hyperbola: then θ = a - b·μ(θ)
    has two roots or none, and θ comes to the larger if it begins above the smaller one.

    curve: a and b, m/s; least: speed without slip, m/s
    """
    at, whole = point[Sliding.SPEED], 1.0 + curve[1] * point[Sliding.VISCOUS]
    a = (curve[0] - curve[1] * point[Sliding.DYNAMIC]) / whole
    c = curve[1] * (point[Sliding.STATIC] - point[Sliding.DYNAMIC]) * at / whole
    square = (a + at) * (a + at) - 4.0 * c
    if not square >= 0.0:
        return least
    root = math.sqrt(square)
    larger, smaller = 0.5 * ((a - at) + root), 0.5 * ((a - at) - root)
    return larger if larger > least and begin >= smaller else least


@noinline
def search_speed(point, curve, begin, least):
    """Return the same for any curve of the coefficient, by steps that never pass a speed that is sought: θ itself moves
    on to a - b·μ(θ), or further by Newton's step, as long as the direction stays."""
    speed = begin
    for _ in range(ROUNDS):
        ahead, slope = distance_ahead(point, curve, speed)
        after = max(least, speed + ahead)
        if slope < 0.0:
            newton = max(least, speed - ahead / slope)
            if ahead * distance_ahead(point, curve, newton)[0] >= 0.0 and abs(newton - speed) > abs(after - speed):
                after = newton
        if abs(after - speed) <= SAME_SPEED * (after + point[Sliding.SPEED]):
            return after
        speed = after
    return speed


@inline
def distance_ahead(point, curve, speed):
    """Return how far a - b·μ(θ) is beyond a speed θ, m/s, and the slope of that."""
    coefficient, slope = coefficient_at(point, speed)
    return curve[0] - curve[1] * coefficient - speed, -curve[1] * slope - 1.0
