"""A method of simulation, as the ruler knows it."""

from collections.abc import Callable
from typing import Any, NamedTuple

from bench.ruler.contact_ruler import Problem, Trajectory


class Method(NamedTuple):
    """A method of simulation, or a variant of one."""

    name: str
    source: str  # authors and year
    simulate: Callable[[Problem, Any], Trajectory]  # of a problem at a setting
    settings: tuple[float, ...]  # time steps per sample at which it is compared, or tolerances


STEPS = (1, 2, 4, 16)  # per sample
