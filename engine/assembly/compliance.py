"""Contact compliance: the displacement at the contacts of an island per newton (docs/design.md, sec. 1)."""

import math

import numpy as np

from engine.assembly.connection_factors import IslandFactors
from engine.assembly.contact_basis import BasisUse
from engine.assembly.double_double import two_product
from engine.assembly.layout import Layout


def contact_compliance(
    layout: Layout, kick: np.ndarray, drift: np.ndarray, factors: list[IslandFactors | None]
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the contact compliance matrix B = Φ diag(e) Φᵀ of each island, with e = v·t, and the rounding errors of
    its diagonal. B is the displacement at contact i per newton at contact j over one step, m/N. An error is what
    rounding cuts from the sum of the products of kick and drift that the kernel uses [contacts].

    Where contacts are solved in the space of a basis, the basis holds these errors, and they are 0 here.

    kick, drift: t and v of each mode, s
    factors:     of the connections of each island, which reduce the displacement at contacts
    """
    islands = layout.islands
    matrices, low, uses = [], [], layout.basis_uses
    for n in range(islands.mode.size - 1):
        modes = slice(islands.mode[n], islands.mode[n + 1])
        shapes, connected = layout.island_contact_shapes(n), factors[n]
        kicks, drifts = shapes * kick[modes], shapes * drift[modes]
        matrix = kicks @ drifts.T
        for k in range(len(shapes)):
            product, error = two_product(kicks[k], drifts[k])
            matrix[k, k] = math.fsum([*product, *error])
            low.append(0.0 if uses[n] is BasisUse.FIRST else math.fsum([*product, *error, -matrix[k, k]]))
        if connected is not None:
            matrix = connected.reduce(shapes, kick[modes], matrix)
        matrices.append(matrix)
    return matrices, np.array(low)
