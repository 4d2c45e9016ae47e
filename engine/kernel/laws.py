"""The laws of contacts, as records: one type for each exponent (engine.kernel.contact_law has their arithmetic)."""

from typing import Any, NamedTuple

import numpy as np

from engine.kernel.axes import PerContact


class Linear(NamedTuple):
    """Contacts with α = 1."""

    potential_coefficient: PerContact
    exponent: PerContact


class Hertz(NamedTuple):
    """Contacts with α = 1.5, two smooth elastic bodies."""

    potential_coefficient: PerContact
    exponent: PerContact


class Quadratic(NamedTuple):
    """Contacts with α = 2."""

    potential_coefficient: PerContact
    exponent: PerContact


class Felt(NamedTuple):
    """Contacts with α = 2.5, as piano hammers have."""

    potential_coefficient: PerContact
    exponent: PerContact


class Cubic(NamedTuple):
    """Contacts with α = 3."""

    potential_coefficient: PerContact
    exponent: PerContact


class Power(NamedTuple):
    """Contacts with any α ≥ 1, each its own."""

    potential_coefficient: PerContact
    exponent: PerContact


Law = Linear | Hertz | Quadratic | Felt | Cubic | Power
OF_EXPONENT = {1.0: Linear, 1.5: Hertz, 2.0: Quadratic, 2.5: Felt, 3.0: Cubic}


def select_law(stiffness: np.ndarray, exponent: np.ndarray, general: bool = False) -> Law:
    """The most special law that holds all the given contacts; the most general if exponents are to change."""
    shared = set(exponent.tolist())
    kind: Any = OF_EXPONENT.get(shared.pop(), Power) if len(shared) == 1 and not general else Power
    law: Law = kind(stiffness / (exponent + 1), exponent)
    return law
