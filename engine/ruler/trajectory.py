"""What a method makes of a problem."""

from typing import NamedTuple

import numpy as np


class Trajectory(NamedTuple):
    """What a method makes of a problem (engine.ruler.problem)."""

    displacement: np.ndarray  # [frames + 1], m, at the pickup, from time 0 on
    force: np.ndarray  # [frames, contacts], N: the mean over each sample
    q: np.ndarray | None = None  # [frames + 1, modes], √kg·m; with p, the energy is that of the continuous system
    p: np.ndarray | None = None  # [frames + 1, modes], √kg·m/s
    seconds: float = float("nan")  # that it took, on one core
