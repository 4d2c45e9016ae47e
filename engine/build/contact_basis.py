"""The basis of an island's contacts: few numbers that say how it can move at many points.

Points closer together than the shortest wave of a body move almost alike. The mode shapes Φ [contacts, modes] of a
bridge of 30 points then have a numerical rank of 4 or 5: Φ = U·Y, and the contact solve has as many unknowns as Y has
rows (engine.kernel.reduced_contact_solver; docs/design.md, sec. 3, "Many points close together").
"""

from typing import NamedTuple

import numpy as np

MIN_CONTACTS = 10  # below, the solve in the space of all contacts is faster
MAX_RANK = 8
KEPT_SINGULAR_VALUE = 1e-9  # of the largest; what is left out moves the points by that much less
SIMD_LANES = 8  # numbers that the solver takes at once; rows of entries at contacts are padded to a multiple


class ContactBasis(NamedTuple):
    """How an island moves at its contacts in a step, √(m/N) and 1/√(kg·m/N): B = U·Uᵀ, Φ = U·Y."""

    at_contacts: np.ndarray  # U [contacts, rank]
    shapes: np.ndarray  # Y [rank, modes]


def truncate_shapes(phi: np.ndarray) -> tuple[np.ndarray, int]:
    """Mode shapes at contacts without their smallest singular values, and how many are left; the shapes as they are,
    and 0, where a basis does not pay.

    phi: [contacts, modes], 1/√kg
    """
    contacts = phi.shape[0]
    if contacts < MIN_CONTACTS:
        return phi, 0
    left, singular, right = np.linalg.svd(phi, full_matrices=False)
    rank = int(np.sum(singular > KEPT_SINGULAR_VALUE * singular[0]))
    if rank == 0 or rank > min(MAX_RANK, contacts // 2):
        return phi, 0
    return (left[:, :rank] * singular[:rank]) @ right[:rank], rank


def contact_basis(phi: np.ndarray, rank: int, kick: np.ndarray, drift: np.ndarray) -> ContactBasis:
    """The basis of mode shapes of a rank, orthonormal in the compliance of the modes: Y·diag(t·v)·Yᵀ = 1.

    phi:         [contacts, modes], 1/√kg
    kick, drift: t and v of each mode, s
    """
    root = np.sqrt(kick * drift)
    left, singular, right = np.linalg.svd(phi * root, full_matrices=False)
    return ContactBasis(left[:, :rank] * singular[:rank], right[:rank] / root)
