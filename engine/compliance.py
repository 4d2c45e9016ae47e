"""How much the bodies of an island give at its contacts, B (DESIGN sec. 1)."""

import math

import numpy as np

from engine.layout import Layout
from engine.model import Modes


def compliances(layout: Layout, modes: Modes) -> tuple[list[np.ndarray], np.ndarray]:
    """B = Φ diag(e) Φᵀ of each island, with e = v·t (DESIGN sec. 1), m/N; and what rounding cut
    from its diagonal, which is the sum of the products of kick and drift that the kernel uses."""
    islands = layout.islands
    matrices, beneath = [], []
    for n in range(islands.mode.size - 1):
        part = slice(islands.mode[n], islands.mode[n + 1])
        ends = [layout.ends(k, spot) for k, spot in layout.spot[islands.contact[n] : islands.contact[n + 1]]]
        shapes = np.array([layout.spread(a, n) + layout.spread(b, n) for a, b in ends]).reshape(
            -1, part.stop - part.start
        )
        kick, drift = shapes * modes.kick[part], shapes * modes.drift[part]
        matrix = kick @ drift.T
        for k in range(len(ends)):
            product, cut = exact_product(kick[k], drift[k])
            matrix[k, k] = math.fsum([*product, *cut])
            beneath.append(math.fsum([*product, *cut, -matrix[k, k]]))
        matrices.append(matrix)
    return matrices, np.array(beneath)


def exact_product(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Products and their rounding errors (Dekker): a·b = product + error exactly."""

    def halves(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        big = 134217729.0 * x
        high = big - (big - x)
        return high, x - high

    (ah, al), (bh, bl) = halves(a), halves(b)
    product = a * b
    return product, ((ah * bh - product) + ah * bl + al * bh) + al * bl
