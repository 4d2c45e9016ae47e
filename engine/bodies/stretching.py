"""Bodies whose tension rises as they stretch."""

import math
from typing import NamedTuple

import numpy as np

from engine.arithmetic.elementary import square


class Stretching(NamedTuple):
    """Energy of the stretch of a body, V = ¼·K·(Σ κ·q²)²; its tension rises by λ = K·Σ κ·q²."""

    stiffness: float  # K: N/m of a string, EA/(2L); N/m³ of a sheet, E·h/(1 - ν²)/(2A)
    kappa: np.ndarray  # κ [modes]: β²/μ, the mean square of the slope of each mode, over the length or the area


def axial_stiffness(young: float, diameter: float) -> float:
    """Return the axial stiffness EA of a round core, N. young: Pa; diameter: m"""
    return young * math.pi * square(diameter) / 4
