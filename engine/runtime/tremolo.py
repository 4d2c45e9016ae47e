"""Tremolo: the output becomes softer and louder in turn, as with the motor of a vibraphone. It acts on the output
alone; no body feels it."""

from typing import Any

import numpy as np

from engine.compiler.decorators import inline


@inline
def tremolo_gain(turns: Any, depth: float) -> Any:
    """Return the factor of the amplitude after so many turns, 1 - depth·sin²(π·turns), to 0.0033·depth.

    sin(πx) is 4u/(5 - u) with u = 4x·(1 - x), for x from 0 to 1 (Bhaskara's formula). turns: a number or an array
    """
    x = turns - np.floor(turns)
    u = 4.0 * x * (1.0 - x)
    sine = 4.0 * u / (5.0 - u)
    return 1.0 - depth * (sine * sine)
