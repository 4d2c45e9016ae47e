"""What depends on the length of a step, as arrays (engine.kernel.model.StepCoefficients)."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from engine.build.compliance import contact_compliance
from engine.build.layout import Layout
from engine.build.mode_shape_rows import row_coefficients
from engine.kernel.model import ContactCoefficients, ModalLoss, SingleContact, StepCoefficients


class ModeCoefficients(NamedTuple):
    """The step of each mode without contact."""

    kick: np.ndarray  # t [modes], s
    drift: np.ndarray  # v [modes], s
    loss: ModalLoss | None  # at either end
    drag: ModalLoss | None  # in the drift


def step_coefficients(
    layout: Layout, modes: ModeCoefficients, samplerate: float, length: float = 1.0
) -> StepCoefficients:
    """The coefficients of a step. length: as a share of a sample, negative for a step back in time."""
    omega = layout.concatenate_modes("omega")
    return StepCoefficients(
        kick=modes.kick,
        drift=modes.drift,
        spring_kick=modes.kick * omega**2 if omega.any() else None,
        loss=modes.loss,
        drag=modes.drag,
        contact=contact_coefficients(layout, modes, samplerate, length) if layout.contact_points else None,
        force=row_coefficients(layout, layout.force_points, modes.kick, modes.drift) if layout.force_order else None,
    )


def contact_coefficients(
    layout: Layout, modes: ModeCoefficients, samplerate: float, length: float
) -> ContactCoefficients:
    """The coefficients of the contacts of a layout, of which there are some. length: as a share of a sample."""
    sides = [layout.contact_sides(k, point) for k, point in layout.contact_points]
    matrices, low = contact_compliance(layout, modes.kick, modes.drift)
    loss = np.array([layout.scene.contact[k].loss for k, _ in layout.contact_points])
    others = [b for _, b in sides]
    joined = any(point.body is not None for point in others)
    return ContactCoefficients(
        rows=row_coefficients(layout, [a for a, _ in sides], modes.kick, modes.drift),
        other_rows=row_coefficients(layout, others, modes.kick, modes.drift) if joined else None,
        compliance=np.concatenate([np.diag(m) for m in matrices]),
        compliance_low=low,
        loss_rate=loss * samplerate / length if loss.any() else None,
        coupling=np.concatenate([m.ravel() for m in matrices]) if any(m.size > 1 for m in matrices) else None,
        single=_single_contacts(layout, modes),
    )


def _single_contacts(layout: Layout, modes: ModeCoefficients) -> SingleContact | None:
    """What the modes of each island do at its one contact; None if an island has several, or forces act."""
    islands = layout.islands
    if np.diff(islands.contact).max() > 1 or layout.force_order:
        return None
    phi = np.zeros(modes.kick.size)
    for n in np.flatnonzero(np.diff(islands.contact)).tolist():
        for side in layout.contact_sides(*layout.contact_points[islands.contact[n]]):
            phi[islands.mode[n] : islands.mode[n + 1]] += layout.dense_mode_shape(side, n)
    return SingleContact(kick_phi=modes.kick * phi, drift_phi=modes.drift * phi)


def stack(records: Sequence[Any]) -> Any:
    """One record of several of the same kind: each array has a row for each of them in front."""
    first = records[0]
    if isinstance(first, np.ndarray):
        return np.array(records)
    if first is None:
        return None
    return type(first)(*(stack(items) for items in zip(*records, strict=True)))
