"""Points of contacts: where they are on either body, and the basis of the mode shapes there.

Points closer together than the shortest wave of a body move almost alike. The mode shapes Φ [contacts, modes] of a
bridge of 30 points then have a numerical rank of 4 or 5: Φ = U·Y, and the contact solve has as many unknowns as Y has
rows (engine.kernel.contact.reduced_contact_solver; docs/design.md, sec. 3, "Many points close together").
"""

import math
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from engine.arithmetic.double_double import two_product
from engine.arithmetic.elementary import square
from engine.arithmetic.linear import cholesky, singular_vectors, solve, span_rows
from engine.arithmetic.plain_numbers import power
from engine.arithmetic.products import product
from engine.assembly.coordinates import IslandFactors
from engine.bodies import Body
from engine.bodies.distributed import LineBody
from engine.bodies.tips import place_of
from engine.kernel.data.enums import COLUMNS, LANES, MAX_RANK, ROWS_COLUMN
from engine.patch.friction import Friction
from engine.patch.tables import Bridge, Contact, Frets


class BodyPoint(NamedTuple):
    """A position on a body, and the factor that multiplies the mode shape there. A barrier has no body."""

    body: str | None
    position: Any  # or a Tip
    factor: float
    phi: np.ndarray | None = None  # the mode shapes there [modes], 1/√kg, if they are not those of the body
    angle: float = 0.0  # rad: direction of motion, of a string with two polarisations


NOWHERE = BodyPoint(None, None, 0.0)


class ContactPoint(NamedTuple):
    """One point of a contact."""

    at: Any  # position on the body
    on_at: Any  # position on the other body
    offset: float  # m: position of the barrier, or the gap
    stiffness: float  # N/m^exponent
    radius: float = 0.0  # m: of what touches the body …
    on_radius: float = 0.0  # … and the other body


def contact_points(contact: Contact | Friction, body: Body, on: Body | None) -> list[ContactPoint]:
    """Return the points of a contact; `body` is the one that touches."""
    if contact.bridge is not None and isinstance(body, LineBody):
        return _bridge(contact.bridge, contact.stiffness, body.length)
    if contact.frets is not None:
        return _frets(contact.frets, contact.stiffness)
    touching, touched = body.split_positions(contact.at), [None] if on is None else on.split_positions(contact.on_at)
    offset = contact.gap if contact.on is not None else contact.barrier
    offsets = offset if isinstance(offset, list) else [offset or 0.0]
    count = max(len(touching), len(touched), len(offsets))
    touching, touched, offsets = (items * count if len(items) == 1 else items for items in (touching, touched, offsets))
    radius, on_radius = _radius(contact, body), _radius(contact, on)
    return [
        ContactPoint(a, b, float(c), contact.stiffness, radius, on_radius)
        for a, b, c in zip(touching, touched, offsets, strict=True)
    ]


def _radius(contact: Contact | Friction, body: Body | None) -> float:
    """Return the radius of what touches a body in a contact, m."""
    if not isinstance(contact, Contact) or body is None:
        return 0.0
    return body.CONTACT_RADIUS if contact.radius is None else contact.radius


def count_points(contact: Contact | Friction) -> int:
    """Return the number of points of a contact, or an upper bound of it, without computing the points."""
    if contact.bridge is not None:
        return contact.bridge.points
    if contact.frets is not None:
        return contact.frets.count or len(contact.frets.at or [])
    lists = (contact.at, contact.on_at, contact.gap if contact.on is not None else contact.barrier)
    return max(len(items) if isinstance(items, list) else 1 for items in lists)


def _bridge(bridge: Bridge, stiffness: float, length: float) -> list[ContactPoint]:
    """Return the points of a bridge, which is a parabola through its top. The points share its stiffness."""
    across = [2 * i / (bridge.points - 1) - 1 for i in range(bridge.points)]  # -1 to 1
    half = bridge.width / length / 2
    return [
        ContactPoint(bridge.at + half * x, None, bridge.height - bridge.depth * square(x), stiffness / bridge.points)
        for x in across
    ]


def _frets(frets: Frets, stiffness: float) -> list[ContactPoint]:
    """Return a point for each fret; each has the whole stiffness. Two heights for several frets are those of the first
    and the last; the others lie on a line between them."""
    at = frets.at or [1 - power(2.0, -n / 12) for n in range(1, (frets.count or 0) + 1)]
    height = frets.height if isinstance(frets.height, list) else [frets.height] * len(at)
    if len(height) == 2 and len(at) > 2:
        low, high = height
        height = [low + (high - low) * (x - at[0]) / (at[-1] - at[0]) for x in at]
    return [ContactPoint(x, None, float(h), stiffness) for x, h in zip(at, height, strict=True)]


FEW_LINEAR_CONTACTS = 24  # of α = 1, without contact loss
MIN_CONTACTS = 10  # below, the solve in the space of all contacts is faster
CERTAIN = 1e3  # times it: so long a rest of a row is a singular value that counts
KEPT_SINGULAR_VALUE = 1e-9  # of the largest; what is left out moves the points by that much less


class BasisUse(Enum):
    """Condition under which the contacts of an island are solved in the space of their basis."""

    NONE = 0  # there is no basis
    FIRST = 1
    IF_CAPPED = 2  # a few linear contacts are solved faster one by one, unless that reaches its iteration limit


class BasisOfIsland(NamedTuple):
    """Basis of an island's contacts in a step, with Φ = U·Y and B = U·(1 + E)·Uᵀ."""

    at_contacts: np.ndarray  # U [contacts, rank], √(m/N)
    rounding: np.ndarray  # E [rank, rank]: rounding error of Y·diag(t·v)·Yᵀ = 1
    shapes: np.ndarray  # Y [rank, modes], 1/√(kg·m/N)


def truncate_shapes(phi: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the mode shapes at contacts without their smallest singular values, and the number of those that remain.
    Where a basis does not pay, return the shapes as they are, and 0.

    phi: [contacts, modes], 1/√kg
    """
    contacts = phi.shape[0]
    if contacts < MIN_CONTACTS or not phi.any():
        return phi, 0
    most = min(MAX_RANK, contacts // 2)
    if len(span_rows(phi, CERTAIN * KEPT_SINGULAR_VALUE, most + 1)) > most:
        return phi, 0
    left, singular, right = singular_vectors(phi, KEPT_SINGULAR_VALUE / CERTAIN)
    rank = int(np.sum(singular > KEPT_SINGULAR_VALUE * singular[0]))
    if rank == MAX_RANK + 1 and singular[MAX_RANK] <= 10.0 * KEPT_SINGULAR_VALUE * singular[0]:
        rank = MAX_RANK  # a voice whose pitch changes keeps its basis
    if rank > most:
        return phi, 0
    return product(left[:, :rank] * singular[:rank], right[:rank]), rank


def find_basis(
    phi: np.ndarray, rank: int, kick: np.ndarray, drift: np.ndarray, factors: IslandFactors | None
) -> BasisOfIsland:
    """Return a basis of the given rank. It is orthonormal in the compliance M of the modes while connections act:
    Y·M·Yᵀ = 1, with M = diag(t·v) if there are none.

    phi:         [contacts, modes], 1/√kg
    kick, drift: t and v of each mode, s
    factors:     of connections
    """
    root = np.sqrt(kick * drift)
    rows = span_rows(phi * root, most=rank)
    shapes, at_contacts = rows / root, product(phi * root, rows.T)
    held = np.zeros((rank, rank))
    if factors is not None:
        lower = cholesky(factors.reduce(factors.contact_moves(shapes * kick), np.eye(rank)))
        shapes, at_contacts = solve(lower, shapes), product(at_contacts, lower)
        held = factors.reduce(factors.contact_moves(shapes * kick), held)
    rounding = np.empty((rank, rank))
    for i, drifts in enumerate(shapes * drift):
        for j, kicks in enumerate(shapes * kick):
            terms, errors = two_product(drifts, kicks)
            rounding[i, j] = math.fsum([*terms, *errors, held[i, j], -float(i == j)])
    at_contacts = at_contacts - product(at_contacts, rounding)  # so that U·Y = Φ though Y·M·Yᵀ is not quite 1
    return BasisOfIsland(at_contacts, rounding, shapes)


def entries_by_row(basis: BasisOfIsland) -> np.ndarray:
    """Return U and then U·E, row by row: five rows of each, padded to a multiple of eight contacts [10 × lanes]."""
    return np.concatenate(
        [_padded(u).T.ravel() for u in (basis.at_contacts, product(basis.at_contacts, basis.rounding))]
    )


def products_by_contact(basis: BasisOfIsland) -> np.ndarray:
    """Return, for each contact, the products U_i·U_j of pairs j ≤ i, and U [lanes × 24]."""
    u = _padded(basis.at_contacts)
    first, second = np.tril_indices(MAX_RANK)
    table = np.zeros((len(u), COLUMNS))
    table[:, : first.size] = u[:, first] * u[:, second]
    table[:, ROWS_COLUMN : ROWS_COLUMN + MAX_RANK] = u
    return table.ravel()


def entry_counts(contacts: int) -> tuple[int, int]:
    """Return the sizes of the arrays of `entries_by_row` and `products_by_contact` for a number of contacts."""
    lanes = -(-contacts // LANES) * LANES
    return 2 * MAX_RANK * lanes, COLUMNS * lanes


def _padded(u: np.ndarray) -> np.ndarray:
    """Return U with zeros for contacts and rows that the basis does not have [lanes, 5]."""
    contacts, rank = u.shape
    return np.pad(u, ((0, -contacts % LANES), (0, MAX_RANK - rank)))


def contact_sides(contact: Contact | Friction, point: ContactPoint) -> tuple[BodyPoint, BodyPoint]:
    """Return the two body points that a contact point joins, each with the sign of its part in the compression."""
    sign = 1.0 if contact.side == "above" else -1.0
    angle = contact.angle if isinstance(contact, Friction) else 0.0
    own, other = place_of(point.at, point.radius), place_of(point.on_at, point.on_radius)
    return BodyPoint(contact.body, own, sign, angle=angle), BodyPoint(contact.on, other, -sign)


def offset(contact: Contact | Friction, point: ContactPoint) -> float:
    """Return the offset that is subtracted from the projected displacement at a point of a contact, m."""
    return -point.offset if contact.on is None and contact.side == "below" else point.offset
