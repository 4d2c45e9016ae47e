"""Laws of contacts: the one-sided power law f(s) = kc·[s]₊^α (paper, eq. 1), one type for each exponent, so that a
kernel holds the arithmetic of its own exponents only.

The type Power has any exponent. For an exponent with a type of its own, it gives the same bits as that type. To add an
exponent, write its class below and add it to SPECIAL_LAWS; engine.kernel.contact.contact_law derives the rest.
"""

import math
from typing import NamedTuple

import numpy as np

from engine.kernel.data.axes import PerContact


class Law(NamedTuple):
    """Contacts with a power law. The law of one exponent has functions for compiled code, each without cancellation:

    power, inverse_power, root_of_potential: x^α, x^(1/α) and x^(1/(α+1)) for x ≥ 0
    quotient: (b^(α+1) - a^(α+1))/(b - a) for a, b ≥ 0, not both 0: α + 1 times the mean of x^α over [a, b]

    Where there is none for a root, it is found as a power.
    """

    potential_coefficient: PerContact  # kc/(α+1), N/m^α
    exponent: PerContact


class Power(Law):
    """Contacts with any α ≥ 1, each its own."""


class Linear(Law):
    """Contacts with α = 1."""

    ALPHA = 1.0
    power = staticmethod(lambda x: x)
    inverse_power = staticmethod(lambda x: x)
    root_of_potential = staticmethod(lambda x: math.sqrt(x))
    quotient = staticmethod(lambda a, b: a + b)


class Hertz(Law):
    """Contacts with α = 1.5, two smooth elastic bodies."""

    ALPHA = 1.5
    power = staticmethod(lambda x: x * math.sqrt(x))

    @staticmethod
    def quotient(a, b):
        """Return (b^(α+1) - a^(α+1))/(b - a), from the roots of a and b."""
        u, v = math.sqrt(a), math.sqrt(b)
        return (a * a + b * b + u * v * (a + u * v + b)) / (u + v)


class Quadratic(Law):
    """Contacts with α = 2."""

    ALPHA = 2.0
    power = staticmethod(lambda x: x * x)
    inverse_power = staticmethod(lambda x: math.sqrt(x))
    quotient = staticmethod(lambda a, b: a * a + a * b + b * b)


class Felt(Law):
    """Contacts with α = 2.5, as piano hammers have."""

    ALPHA = 2.5
    power = staticmethod(lambda x: x * x * math.sqrt(x))

    @staticmethod
    def quotient(a, b):
        """Return (b^(α+1) - a^(α+1))/(b - a), from the roots of a and b."""
        u, v = math.sqrt(a), math.sqrt(b)
        a2, b2, uv = a * a, b * b, u * v
        return (a2 * a + b2 * b + uv * (a2 + b2 + a * b) + a * b * (a + b)) / (u + v)


class Cubic(Law):
    """Contacts with α = 3."""

    ALPHA = 3.0
    power = staticmethod(lambda x: x * x * x)
    root_of_potential = staticmethod(lambda x: math.sqrt(math.sqrt(x)))
    quotient = staticmethod(lambda a, b: (a + b) * (a * a + b * b))


SPECIAL_LAWS = (Linear, Hertz, Quadratic, Felt, Cubic)


NO_NUMBERS = np.zeros(0)


def select_law(exponent: np.ndarray, general: bool = False) -> type[Law]:
    """Return the most special law that holds contacts with the given exponents; the most general if these are to
    change."""
    shared = set(exponent.tolist())
    of_exponent: dict[float, type[Law]] = {law.ALPHA: law for law in SPECIAL_LAWS}
    if not shared:
        return Linear
    return of_exponent.get(shared.pop(), Power) if len(shared) == 1 and not general else Power
