"""The law of contacts: the one-sided power law f(s) = kc·[s]₊^α (paper, eq. 1), of any exponent α ≥ 1.

Some exponents have functions of their own, which are faster. To add one, write its class below and add it to
SPECIAL_EXPONENTS; engine.kernel.contact.power_law derives the rest.
"""

import math
from typing import NamedTuple

from engine.kernel.data.axes import PerContact


class Law(NamedTuple):
    """Numbers of the power law of each contact."""

    potential_coefficient: PerContact  # kc/(α+1), N/m^α
    exponent: PerContact


# Functions of one exponent, for compiled code, each without cancellation; where there is none, it is found as a power:
#
# power, inverse_power, root_of_potential: x^α, x^(1/α) and x^(1/(α+1)) for x ≥ 0
# quotient: (b^(α+1) - a^(α+1))/(b - a) for a, b ≥ 0, not both 0: α + 1 times the mean of x^α over [a, b]; the value is
#     (a, b, …), as engine.kernel.contact.power_law.general_quotient has it


class Linear:
    """α = 1."""

    ALPHA = 1.0
    power = staticmethod(lambda x: x)
    inverse_power = staticmethod(lambda x: x)
    root_of_potential = staticmethod(lambda x: math.sqrt(x))
    quotient = staticmethod(lambda value: value[0] + value[1])


class Hertz:
    """α = 1.5, two smooth elastic bodies."""

    ALPHA = 1.5
    power = staticmethod(lambda x: x * math.sqrt(x))

    @staticmethod
    def quotient(value):
        """Return (b^(α+1) - a^(α+1))/(b - a), from the roots of a and b."""
        a, b, _, _ = value
        u, v = math.sqrt(a), math.sqrt(b)
        return (a * a + b * b + u * v * (a + u * v + b)) / (u + v)


class Quadratic:
    """α = 2."""

    ALPHA = 2.0
    power = staticmethod(lambda x: x * x)
    inverse_power = staticmethod(lambda x: math.sqrt(x))

    @staticmethod
    def quotient(value):
        """Return (b^(α+1) - a^(α+1))/(b - a)."""
        a, b, _, _ = value
        return a * a + a * b + b * b


class Felt:
    """α = 2.5, as piano hammers have."""

    ALPHA = 2.5
    power = staticmethod(lambda x: x * x * math.sqrt(x))

    @staticmethod
    def quotient(value):
        """Return (b^(α+1) - a^(α+1))/(b - a), from the roots of a and b."""
        a, b, _, _ = value
        u, v = math.sqrt(a), math.sqrt(b)
        a2, b2, uv = a * a, b * b, u * v
        return (a2 * a + b2 * b + uv * (a2 + b2 + a * b) + a * b * (a + b)) / (u + v)


class Cubic:
    """α = 3."""

    ALPHA = 3.0
    power = staticmethod(lambda x: x * x * x)
    root_of_potential = staticmethod(lambda x: math.sqrt(math.sqrt(x)))

    @staticmethod
    def quotient(value):
        """Return (b^(α+1) - a^(α+1))/(b - a)."""
        a, b, _, _ = value
        return (a + b) * (a * a + b * b)


SPECIAL_EXPONENTS = Linear, Hertz, Quadratic, Felt, Cubic
