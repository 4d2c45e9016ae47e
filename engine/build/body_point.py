"""A position on a body, as the parts of a build hand it on."""

from typing import Any, NamedTuple

import numpy as np


class BodyPoint(NamedTuple):
    """A position on a body, with a factor on the mode shape there; no body: a barrier."""

    body: str | None
    position: Any
    factor: float
    phi: np.ndarray | None = None  # the mode shapes there [modes], 1/√kg, if they are not those of the body


NOWHERE = BodyPoint(None, None, 0.0)
