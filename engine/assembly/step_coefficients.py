"""Coefficients that depend on the length of a step, as arrays (engine.kernel.data.model.StepCoefficients), among them
the compliance of contacts: the displacement at the contacts of an island per newton (docs/design.md, sec. 1).
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from engine.arithmetic.double_double import two_product
from engine.arithmetic.elementary import square
from engine.assembly.array_memory import ABSENT
from engine.assembly.connections import ContactMotion, all_factors, connection_coefficients, contact_motions
from engine.assembly.coordinates import IslandFactors
from engine.assembly.layout import Layout
from engine.assembly.mode_coefficients import ModeCoefficients
from engine.assembly.mode_shape_rows import row_coefficients
from engine.kernel.data.model import ContactCoefficients, StepCoefficients


def contact_compliance(
    layout: Layout,
    modes: ModeCoefficients,
    factors: Sequence[IslandFactors | None],
    motions: Sequence[ContactMotion],
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the contact compliance matrix B = Φ diag(e) Φᵀ of each island, with e = v·t, and the rounding errors of
    its diagonal. B is the displacement at contact i per newton at contact j over one step, m/N. An error is what
    rounding cuts from the sum of the products of kick and drift that the kernel uses [contacts].

    factors: of the connections of each island, which reduce the displacement at contacts
    motions: of each island
    """
    matrices, low = [], []
    islands = zip(layout.points.contact_shapes, layout.modes.of_island, factors, motions, strict=True)
    for shapes, inside, connected, motion in islands:
        matrix, phi, modes_at = motion.compliance.copy(), shapes.phi[shapes.moved], shapes.moved[1]
        product, error = two_product(phi * modes.kick[inside][modes_at], phi * modes.drift[inside][modes_at])
        products, errors = product.tolist(), error.tolist()
        ends = np.searchsorted(shapes.moved[0], np.arange(len(matrix) + 1)).tolist()
        for k, (begin, end) in enumerate(pairwise(ends)):
            terms = products[begin:end] + errors[begin:end]
            matrix[k, k] = total = math.fsum(terms)
            low.append(math.fsum([*terms, -total]))
        matrices.append(matrix if connected is None else connected.reduce(motion.moves, matrix))
    return matrices, np.array(low)


def step_coefficients(
    layout: Layout,
    modes: ModeCoefficients,
    samplerate: float,
    length: float = 1.0,
    loses_at_points: bool = True,
) -> StepCoefficients:
    """Return the coefficients of a step.

    length:    as a share of a sample, negative for a step back in time
    loses_at_points: True if contact loss and dampers of connections act in the step
    """
    omega, weight, forces = layout.modes.omega, layout.modes.weight, layout.points.forces
    rate = samplerate / length if loses_at_points else 0.0
    factors = all_factors(layout, modes, rate)
    motions = contact_motions(layout, modes, factors)
    return StepCoefficients(
        kick=modes.kick,
        drift=modes.drift,
        spring_kick=modes.kick * square(omega) if omega.any() else ABSENT,
        weight_kick=modes.kick * weight if weight.any() else ABSENT,
        loss=modes.loss,
        drag=modes.drag,
        connection=connection_coefficients(layout, modes, factors, motions, rate),
        contact=contact_coefficients(layout, modes, factors, motions, rate) if layout.points.contacts else ABSENT,
        force=row_coefficients(forces, modes.kick, modes.drift) if forces else ABSENT,
    )


def contact_coefficients(
    layout: Layout,
    modes: ModeCoefficients,
    factors: Sequence[IslandFactors | None],
    motions: Sequence[ContactMotion],
    rate: float,
) -> ContactCoefficients:
    """Return the coefficients of the contacts of a layout, which must have some.

    factors: of the connections of each island; motions: by its contacts
    rate:    one over the length of the step, 1/s; 0 if contact loss acts outside it
    """
    matrices, low = contact_compliance(layout, modes, factors, motions)
    loss = np.array([layout.touching[k].loss for k, _ in layout.islands.contact_points])
    ours, theirs = zip(*layout.points.contacts, strict=True)
    return ContactCoefficients(
        rows=row_coefficients(ours, modes.kick, modes.drift),
        other_rows=row_coefficients(theirs, modes.kick, modes.drift) if any(row.phi.size for row in theirs) else ABSENT,
        compliance=np.concatenate([np.diag(m) for m in matrices]),
        compliance_low=low,
        loss_rate=loss * rate if loss.any() else ABSENT,
        coupling=np.concatenate([m.ravel() for m in matrices]) if any(m.size > 1 for m in matrices) else ABSENT,
        duration=np.full(loss.size, 1 / rate) if layout.scene.friction else ABSENT,
        only_kick_phi=_kicks_by_only_contacts(layout, modes),
    )


def _kicks_by_only_contacts(layout: Layout, modes: ModeCoefficients) -> np.ndarray:
    """Return t·Φ of the modes of islands with one contact and no connection, and zeros elsewhere [modes]."""
    phi = np.zeros(modes.kick.size)
    for n, inside in enumerate(layout.modes.of_island):
        shapes = layout.points.contact_shapes[n].phi
        if len(shapes) == 1 and not layout.islands.coordinates[n].items:
            phi[inside] = shapes[0]
    return np.asarray(modes.kick * phi)


def stack(records: Sequence[Any]) -> Any:
    """Stack records of the same class into one: each array has a row for each record in front."""
    first = records[0]
    if isinstance(first, np.ndarray):
        return np.array(records)
    if first is ABSENT:
        return ABSENT
    return type(first)(*(stack(items) for items in zip(*records, strict=True)))
