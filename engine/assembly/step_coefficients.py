"""Coefficients that depend on the length of a step, as arrays (engine.kernel.data.model.StepCoefficients), among them
the compliance of contacts: the displacement at the contacts of an island per newton (docs/design.md, sec. 1).
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.connections import connection_coefficients, island_factors
from engine.assembly.contact_points import BasisUse, entries_by_row, find_basis, products_by_contact
from engine.assembly.coordinates import IslandFactors
from engine.assembly.double_double import two_product
from engine.assembly.layout import Layout, ShapeRow
from engine.assembly.mode_shape_rows import row_coefficients
from engine.kernel.data.model import BasisCoefficients, ContactCoefficients, ModalLoss, StepCoefficients


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


class ModeCoefficients(NamedTuple):
    """Coefficients of a step of each mode, without contact."""

    kick: np.ndarray  # t [modes], s
    drift: np.ndarray  # v [modes], s
    loss: ModalLoss | None  # at either end
    drag: ModalLoss | None  # in the drift


def step_coefficients(
    layout: Layout,
    modes: ModeCoefficients,
    samplerate: float,
    length: float = 1.0,
    *,
    is_damped: bool = True,
    loses_at_contacts: bool = True,
) -> StepCoefficients:
    """Return the coefficients of a step.

    length:    as a share of a sample, negative for a step back in time
    is_damped: True if dampers of connections act in the step
    loses_at_contacts: True if contact loss acts in the step
    """
    step_rate = samplerate / length if is_damped else 0.0
    omega, weights = layout.concatenate_modes("omega"), layout.weights()
    forced = [layout.row(point) for point in layout.force_points]
    return StepCoefficients(
        kick=modes.kick,
        drift=modes.drift,
        spring_kick=modes.kick * omega**2 if omega.any() else None,
        weight_kick=modes.kick * weights if weights.any() else None,
        loss=modes.loss,
        drag=modes.drag,
        connection=connection_coefficients(layout, modes.kick, modes.drift, step_rate),
        contact=contact_coefficients(layout, modes, samplerate / length * loses_at_contacts, step_rate)
        if layout.contact_points
        else None,
        force=row_coefficients(forced, modes.kick, modes.drift) if forced else None,
    )


def contact_coefficients(layout: Layout, modes: ModeCoefficients, rate: float, step_rate: float) -> ContactCoefficients:
    """Return the coefficients of the contacts of a layout, which must have some.

    rate:      one over the length of the step, 1/s; 0 if contact loss acts outside it
    step_rate: the same for dampers of connections; 0 if they act outside it
    """
    factors = all_factors(layout, modes, step_rate)
    matrices, low = contact_compliance(layout, modes.kick, modes.drift, factors)
    loss = np.array([layout.scene.contact[k].loss for k, _ in layout.contact_points])
    ours = [layout.row(a) for a, _ in layout.contact_rows]
    theirs = [layout.row(b) for _, b in layout.contact_rows]
    joined = any(row.phi.size for row in theirs)
    return ContactCoefficients(
        rows=row_coefficients(ours, modes.kick, modes.drift),
        other_rows=row_coefficients(theirs, modes.kick, modes.drift) if joined else None,
        compliance=np.concatenate([np.diag(m) for m in matrices]),
        compliance_low=low,
        loss_rate=loss * rate if loss.any() else None,
        coupling=np.concatenate([m.ravel() for m in matrices]) if any(m.size > 1 for m in matrices) else None,
        only_kick_phi=_kicks_by_only_contacts(layout, modes),
        basis=_basis_coefficients(layout, modes, factors),
    )


def all_factors(layout: Layout, modes: ModeCoefficients, step_rate: float) -> list[IslandFactors | None]:
    """Return the factors of the connections of each island; None for an island without any."""
    spans = [slice(*layout.islands.mode[n : n + 2]) for n in range(layout.islands.mode.size - 1)]
    return [island_factors(layout, n, modes.kick[m], modes.drift[m], step_rate) for n, m in enumerate(spans)]


class BasisTables(NamedTuple):
    """Bases of the contacts of all islands, in the layout of the kernels."""

    rows: list[ShapeRow]
    at_contacts: list[np.ndarray]  # of each island that has one
    products: list[np.ndarray]
    ranks: list[int]


def contact_basis_tables(
    layout: Layout, modes: ModeCoefficients, factors: Sequence[IslandFactors | None]
) -> BasisTables:
    """Return the bases of the contacts of all islands that have one."""
    begins, tables = layout.islands.mode, BasisTables([], [], [], [])
    for n, (phi, rank) in enumerate(layout.contact_shapes):
        if rank:
            inside = slice(begins[n], begins[n + 1])
            basis = find_basis(phi, rank, modes.kick[inside], modes.drift[inside], factors[n])
            tables.rows.extend(ShapeRow(0, int(begins[n]), shape) for shape in basis.shapes)
            tables.at_contacts.append(entries_by_row(basis))
            tables.products.append(products_by_contact(basis))
            tables.ranks.append(rank)
    return tables


def _basis_coefficients(
    layout: Layout, modes: ModeCoefficients, factors: Sequence[IslandFactors | None]
) -> BasisCoefficients | None:
    """Return the step coefficients of the rows of all bases; None without any."""
    tables = contact_basis_tables(layout, modes, factors)
    if not tables.rows:
        return None
    rows = row_coefficients(tables.rows, modes.kick, modes.drift)
    return BasisCoefficients(rows, np.concatenate(tables.at_contacts), np.concatenate(tables.products))


def _kicks_by_only_contacts(layout: Layout, modes: ModeCoefficients) -> np.ndarray | None:
    """Return t·Φ of the modes of islands with one contact and no connection, and zeros elsewhere [modes]; None if there
    is no such island."""
    islands = layout.islands
    has_one = (np.diff(islands.contact) == 1) & (np.diff(islands.connection) == 0)
    if not has_one.any():
        return None
    phi = np.zeros(modes.kick.size)
    for n in np.flatnonzero(has_one).tolist():
        for side in layout.contact_rows[islands.contact[n]]:
            phi[islands.mode[n] : islands.mode[n + 1]] += layout.dense_mode_shape(side, n)
    return modes.kick * phi


def stack(records: Sequence[Any]) -> Any:
    """Stack records of the same class into one: each array has a row for each record in front."""
    first = records[0]
    if isinstance(first, np.ndarray):
        return np.array(records)
    if first is None:
        return None
    return type(first)(*(stack(items) for items in zip(*records, strict=True)))
