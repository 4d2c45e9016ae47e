"""Contact compliance: how much the bodies of an island give at its contacts (docs/design.md, sec. 1)."""

import math

import numpy as np

from engine.build.contact_basis import BasisUse
from engine.build.double_double import two_product
from engine.build.layout import Layout


def contact_compliance(layout: Layout, kick: np.ndarray, drift: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Contact compliance matrix B = Φ diag(e) Φᵀ of each island, with e = v·t: displacement at contact i per newton at
    contact j over one step, m/N. And what rounding cut from its diagonal, which is the sum of the products of kick and
    drift that the kernel uses [contacts].

    Where contacts are solved in the space of a basis, what rounding cut is with it, and 0 here.

    kick, drift: t and v of each mode, s
    """
    islands = layout.islands
    matrices, low, uses = [], [], layout.basis_uses
    for n in range(islands.mode.size - 1):
        modes = slice(islands.mode[n], islands.mode[n + 1])
        sides = layout.contact_rows[islands.contact[n] : islands.contact[n + 1]]
        shapes = np.array([layout.dense_mode_shape(a, n) + layout.dense_mode_shape(b, n) for a, b in sides])
        shapes = shapes.reshape(-1, modes.stop - modes.start)
        kicks, drifts = shapes * kick[modes], shapes * drift[modes]
        matrix = kicks @ drifts.T
        for k in range(len(sides)):
            product, error = two_product(kicks[k], drifts[k])
            matrix[k, k] = math.fsum([*product, *error])
            low.append(0.0 if uses[n] is BasisUse.FIRST else math.fsum([*product, *error, -matrix[k, k]]))
        matrices.append(matrix)
    return matrices, np.array(low)
