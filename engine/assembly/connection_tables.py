"""Connections in the layout of the kernels: rows, compliance, and the factors of their forces
(engine.kernel.interactions.connection_factors)."""

import math
from itertools import pairwise

import numpy as np

from engine.assembly.connection_factors import IslandFactors, find_factors
from engine.assembly.contact_reach import contact_reach, contact_reach_by_forces, dense_rows
from engine.assembly.coordinates import Coordinates
from engine.assembly.layout import Layout
from engine.assembly.mode_shape_rows import mode_shape_rows, row_coefficients
from engine.kernel.data.enums import FLIGHT_FRAMES
from engine.kernel.data.model import ConnectionCoefficients, Connections, StepCoefficients

MAX_MODES_AT_REST = 400  # of an island under load; with more, its energy at rest is not computed


def island_factors(
    layout: Layout, island: int, kick: np.ndarray, drift: np.ndarray, step_rate: float
) -> IslandFactors | None:
    """Return the factors of an island's connections; None without any.

    kick, drift: t and v of the modes of the island, s
    step_rate:   one over the length of the step, 1/s; 0 if dampers act outside it
    """
    coordinates = layout.coordinates[island]
    if not coordinates.items:
        return None
    rows = dense_rows(layout, island)
    kicks, drifts = rows * kick, rows * drift
    compliance = kicks @ drifts.T
    return IslandFactors(compliance, *find_factors(coordinates, compliance, step_rate), kicks, drifts)


def connection_coefficients(
    layout: Layout, kick: np.ndarray, drift: np.ndarray, step_rate: float
) -> ConnectionCoefficients | None:
    """Return the coefficients of all connections of a layout; None without any."""
    if not layout.connection_parts:
        return None
    begins = layout.islands.mode
    values: list[list[np.ndarray]] = [[] for _ in range(5)]
    for n in range(begins.size - 1):
        inside = slice(begins[n], begins[n + 1])
        factors = island_factors(layout, n, kick[inside], drift[inside], step_rate)
        shapes = layout.island_contact_shapes(n)
        empty = np.zeros((0, 0))
        moves = factors.contact_moves(shapes, kick[inside]) if factors is not None else empty
        matrices = factors[:3] if factors is not None else (empty,) * 3
        contacts = (shapes * kick[inside]) @ (shapes * drift[inside]).T
        for kept, matrix in zip(values, (*matrices, moves, contacts), strict=True):
            kept.append(matrix.ravel())
    compliance, per_extension, per_move, contact_moves, contact_compliance = map(np.concatenate, values)
    items = [item for coordinates in layout.coordinates for item in coordinates.items]
    rows = row_coefficients([part.row for part in layout.connection_parts], kick, drift)
    return ConnectionCoefficients(
        rows=rows,
        compliance=compliance,
        force_per_extension=per_extension,
        force_per_move=per_move,
        step_rate=np.full(len(items), step_rate),
        made_for_stiffness=np.array([item.stiffness for item in items]),
        made_for_damping=np.array([item.damping for item in items]),
        contact_moves=contact_moves,
        contact_compliance=contact_compliance,
    )


def connections(
    layout: Layout, samplerate: float, step: StepCoefficients, weight: np.ndarray | None, is_refined: bool
) -> Connections | None:
    """Return the connections of a layout; None without any.

    step:       coefficients of a sample that is one step
    weight:     of each mode; None if no mode has weight
    is_refined: True if samples are made of stages
    """
    if not layout.connection_parts:
        return None
    items = [item for coordinates in layout.coordinates for item in coordinates.items]
    unconnected = np.ones(int(layout.islands.mode[-1]))
    for b in layout.connected_body_numbers:
        unconnected[layout.global_modes(b)] = 0.0
    is_plain = _plain_islands(layout, weight, step.drag is not None)
    return Connections(
        rows=mode_shape_rows([part.row for part in layout.connection_parts]),
        coordinate=np.array([part.coordinate for part in layout.connection_parts], np.int64),
        coupling=np.concatenate([c.coupling.ravel() for c in layout.coordinates]),
        is_rigid=np.array([item.is_rigid for item in items], np.int64),
        is_unconnected=unconnected,
        is_plain=is_plain.astype(np.int64),
        contact_reach=contact_reach(layout, FLIGHT_FRAMES / samplerate),
        contact_reach_by_forces=contact_reach_by_forces(layout, step, is_plain & (not is_refined)),
    )


def _plain_islands(layout: Layout, weight: np.ndarray | None, has_drag: bool) -> np.ndarray:
    """True for each island whose modes have neither weight nor loss in the drift [islands]."""
    begins = layout.islands.mode
    loads = [weight is not None and weight[a:b].any() for a, b in pairwise(begins)]
    return np.array([not (has_drag or is_loaded) for is_loaded in loads])


# --- at rest


def lowest_energies(layout: Layout) -> np.ndarray:
    """Return the energy of the connected bodies of each island at rest, J [islands]. It is 0 without weight and without
    springs under load. It is minus infinity where finding it takes too long."""
    omega, weight, begins = layout.concatenate_modes("omega"), layout.weights(), layout.islands.mode
    lowest = []
    for n, coordinates in enumerate(layout.coordinates):
        inside = slice(begins[n], begins[n + 1])
        connected = [
            m for b in layout.bodies_of_island(n) if b in layout.connected_body_numbers for m in _indices(layout, b)
        ]
        load = weight[inside][connected]
        if not coordinates.items or not (load.any() or any(item.rest for item in coordinates.items)):
            lowest.append(0.0)
        elif len(connected) > MAX_MODES_AT_REST:
            lowest.append(-math.inf)
        else:
            lowest.append(
                _energy_at_rest(coordinates, dense_rows(layout, n)[:, connected], omega[inside][connected], load)
            )
    return np.array(lowest)


def _indices(layout: Layout, body: int) -> range:
    modes = layout.local_modes(body)
    return range(modes.start, modes.stop)


def _energy_at_rest(coordinates: Coordinates, rows: np.ndarray, omega: np.ndarray, load: np.ndarray) -> float:
    """Return the minimum of ½q·ω²·q + ½s·K·s - load·q with s = rows·q - rest, and s = 0 where rigid, J. Return minus
    infinity if there is none, as when a body falls for ever."""
    items, size = coordinates.items, omega.size
    stiffness = coordinates.coupling + np.diag([item.stiffness for item in items])
    rest, rigid = np.array([item.rest for item in items]), np.array([item.is_rigid for item in items])
    held = rows[rigid]
    matrix = np.zeros((size + len(held), size + len(held)))
    matrix[:size, :size] = np.diag(omega**2) + rows.T @ stiffness @ rows
    matrix[size:, :size], matrix[:size, size:] = held, held.T
    pull = np.concatenate([load + rows.T @ stiffness @ rest, rest[rigid]])
    solution, *_ = np.linalg.lstsq(matrix, pull, rcond=None)
    if np.max(np.abs(matrix @ solution - pull)) > 1e-9 * np.max(np.abs(pull)):
        return -math.inf
    q = solution[:size]
    s = rows @ q - rest
    return float(0.5 * np.sum((omega * q) ** 2) + 0.5 * s @ stiffness @ s - load @ q)
