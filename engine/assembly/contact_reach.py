"""Bounds on how far connected bodies can move contacts in a flight, per √(2E) of their energy E (docs/design.md,
"Connections")."""

import math

import numpy as np

from engine.assembly.layout import Layout
from engine.kernel.data.enums import FLIGHT_FRAMES
from engine.kernel.data.model import StepCoefficients

UNBOUNDED = 1e300  # m/√J; infinity times no energy would be no number


def dense_rows(layout: Layout, island: int) -> np.ndarray:
    """Return the rows of an island's coordinates over all its modes [coordinates, modes]."""
    items = layout.coordinates[island].items
    rows = np.zeros((len(items), int(layout.islands.mode[island + 1] - layout.islands.mode[island])))
    for row, item in zip(rows, items, strict=True):
        for body, values in item.parts.items():
            row[layout.local_modes(body)] = values
    return rows


def contact_reach(layout: Layout, seconds: float) -> np.ndarray:
    """Bound how far connected bodies can close each contact in `seconds`, m per √(2E) of their energy, √J [contacts].

    A displacement Φ·q of energy E changes no faster than √(2E·ΣΦ²), and is at most √(2E·C), with C its static
    compliance. Both follow from the Cauchy-Schwarz inequality, and hold for any springs of the connections.
    """
    omega, begins, reach = layout.concatenate_modes("omega"), layout.islands.mode, []
    for n in range(begins.size - 1):
        shapes, inside = layout.island_contact_shapes(n), omega[begins[n] : begins[n + 1]]
        if not layout.coordinates[n].items:
            reach.append(np.zeros(len(shapes)))
            continue
        for b in layout.bodies_of_island(n):
            if b not in layout.connected_body_numbers:
                shapes[:, layout.local_modes(b)] = 0.0
        limit = np.array([2 * math.sqrt(c) for c in _static_compliances(layout, n, shapes, inside)])
        reach.append(np.minimum(seconds * np.sqrt(np.sum(shapes**2, axis=1)), limit.reshape(-1)))
    return np.concatenate(reach)


def _static_compliances(layout: Layout, island: int, shapes: np.ndarray, omega: np.ndarray) -> list[float]:
    """Return Φ·H⁻¹·Φᵀ of each mode shape. H is the stiffness of the modes with the ends of strings. The value is
    infinite if a free mass takes part."""
    coupling = layout.coordinates[island].coupling
    ends = np.flatnonzero(np.any(coupling != 0.0, axis=1))
    rows, compliances = dense_rows(layout, island)[ends], []
    free = omega == 0.0
    modal_compliance = 1 / np.where(free, 1.0, omega) ** 2
    held = coupling[np.ix_(ends, ends)]
    factor = np.linalg.solve(np.eye(ends.size) + held @ (rows * modal_compliance) @ rows.T, held)
    for phi in shapes:
        if np.any(phi[free] != 0.0) or (ends.size and np.any(rows[:, free])):
            compliances.append(math.inf)
            continue
        moved = (rows * modal_compliance) @ phi
        compliances.append(max(0.0, float(phi * modal_compliance @ phi - moved @ factor @ moved)))
    return compliances


# --- by the forces of connections


def contact_reach_by_forces(layout: Layout, step: StepCoefficients, is_bounded: np.ndarray) -> np.ndarray:
    """Bound how much further each contact can close in a flight than its bodies alone would close it, m per √(2E) of
    the connected bodies, √J [contacts].

    A connection with the force f moves a contact by at most max|f| times the sum, over the steps that follow, of the
    size of the displacement per newton in one step. And f is at most √(2E·ℓ·H⁻¹·ℓᵀ), with ℓ the force per displacement.

    is_bounded: True for islands in which this holds, with single steps and without weight [islands]
    """
    reach = []
    for n in range(layout.islands.mode.size - 1):
        shapes, items = layout.island_contact_shapes(n), layout.coordinates[n].items
        if not len(shapes) or not items:
            reach.append(np.zeros(len(shapes)))
        elif is_bounded[n] and not layout.is_variable(n):
            inside = slice(layout.islands.mode[n], layout.islands.mode[n + 1])
            forces = np.minimum(_largest_forces(layout, n, layout.concatenate_modes("omega")[inside]), UNBOUNDED)
            moves = _sums_of_moves(shapes, dense_rows(layout, n), _modes_after_push(step, inside))
            reach.append(np.minimum(moves @ forces, UNBOUNDED))
        else:
            reach.append(np.full(len(shapes), UNBOUNDED))
    return np.concatenate(reach)


def _largest_forces(layout: Layout, island: int, omega: np.ndarray) -> np.ndarray:
    """Return the largest force at each coordinate of an island, N per √(2E) of the connected bodies [coordinates]. It
    is infinite if a damper or a rigid joint takes part."""
    items, coupling = layout.coordinates[island].items, layout.coordinates[island].coupling
    stiffness = np.array([item.stiffness for item in items])
    rows = coupling @ dense_rows(layout, island)
    by_coupling = np.sqrt(_static_compliances(layout, island, rows, omega))
    forces = np.where(np.any(coupling != 0.0, axis=1), by_coupling, 0.0) + np.sqrt(stiffness)
    return np.where([item.is_rigid or item.damping != 0.0 for item in items], math.inf, forces)


def _modes_after_push(step: StepCoefficients, inside: slice) -> np.ndarray:
    """Return the displacement of modes in each sample of a flight, per newton on their mode shapes in the first step
    [modes, samples]."""
    kick, drift = step.kick[inside], step.drift[inside]
    spring = np.zeros(kick.size) if step.spring_kick is None else step.spring_kick[inside]
    decay = np.ones(kick.size) if step.loss is None else step.loss.decay_factor[inside]
    q, p, moved = np.zeros(kick.size), np.zeros(kick.size), np.zeros((FLIGHT_FRAMES, kick.size))
    for n in range(FLIGHT_FRAMES):
        push = kick if n == 0 else 0.0
        p = decay * p - spring * q + push
        q = q + drift * p
        p = decay * (p - spring * q + push)
        moved[n] = q
    return moved.T


def _sums_of_moves(shapes: np.ndarray, rows: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return the sum over all samples of the size of each contact's displacement per newton at each coordinate, m/N
    [contacts, coordinates].

    shapes: at contacts [contacts, modes]; rows: of coordinates [coordinates, modes]
    """
    sums = np.zeros((len(shapes), len(rows)))
    for k, phi in enumerate(shapes):
        used = np.flatnonzero(phi)
        held = np.flatnonzero(np.any(rows[:, used] != 0.0, axis=1))
        sums[k, held] = np.sum(np.abs((rows[np.ix_(held, used)] * phi[used]) @ moved[used]), axis=1)
    return sums
