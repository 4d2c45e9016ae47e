"""A position on a body, with the mode shapes there."""

from typing import Any, NamedTuple

import numpy as np


class BodyPoint(NamedTuple):
    """A position on a body, and the factor that multiplies the mode shape there. A barrier has no body."""

    body: str | None
    position: Any
    factor: float
    phi: np.ndarray | None = None  # the mode shapes there [modes], 1/√kg, if they are not those of the body


NOWHERE = BodyPoint(None, None, 0.0)
