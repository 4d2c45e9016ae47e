"""Coordinates of connections as records, the factors of their forces in a step, which
engine.kernel.interactions.connection_factors computes again after a change, and the compensation of springs.

Compensation of springs for the error of a step (docs/design.md, "Connections").

A force that is constant over a step, and follows from the mean of the extensions at its ends, acts on a compliance that
is too small at high frequencies: by the factor 1 - θ²/6 to leading order, θ = ωh, for every mode. With the mode shapes
γₙ·Φₙ in place of Φₙ, γₙ² = θₙ/sin θₙ, each mode has the right compliance at its own frequency. But together they have a
constant excess of compliance between springs i and j, C_ij = Σ (γₙ² - 1)·Φᵢ·Φⱼ/ωₙ². The compliance of the springs is
reduced by it: K⁻¹ → K⁻¹ - C. Springs that are too stiff for this are compensated in part. Springs that share an excess
with a damper, a rigid joint or a spring that may change are not compensated.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from engine.arithmetic.elementary import sin, square
from engine.arithmetic.linear import solve, symmetric_eigenvectors
from engine.arithmetic.products import product


class Coordinate(NamedTuple):
    """A coordinate of connections: the sum of row · modal displacements over its bodies, minus its rest length."""

    path: str  # in the patch
    connection: int | None  # number of its connection
    parts: dict[int, np.ndarray]  # by number of the body: its row [modes], 1/√kg; of w in N/(√kg·m)
    stiffness: float = 0.0  # N/m
    damping: float = 0.0  # kg/s
    rest: float = 0.0  # m
    is_rigid: bool = False
    slope_of: tuple[int, int] | None = None  # of a string at its end: connection, and how far behind y it comes
    excess: float = 0.0  # m/N: compliance of its rows beyond that of its bodies (engine.assembly.coordinates)


class Coordinates(NamedTuple):
    """All coordinates of an island, and the stiffness that couples them."""

    items: list[Coordinate]
    coupling: np.ndarray  # [items, items], N/m: stiffness between coordinates

    def stiffness(self) -> np.ndarray:
        """Return the stiffness matrix, that of the springs included [items, items], N/m."""
        return np.asarray(self.coupling + np.diag([item.stiffness for item in self.items]))


class IslandFactors(NamedTuple):
    """Factors of the connections of an island in a step."""

    compliance: np.ndarray  # B [coordinates, coordinates]
    per_extension: np.ndarray  # X
    per_move: np.ndarray  # Y
    drifts: np.ndarray  # v·rows [coordinates, modes]

    def reduce(self, moves: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Return the compliance [rows, rows] of points while connections act. `matrix` is that without connections.

        moves: of the coordinates by the points (contact_moves)
        """
        return np.asarray(matrix - product(product(moves.T, self.per_move), moves))

    def contact_moves(self, kicks: np.ndarray) -> np.ndarray:
        """Return the displacement of each coordinate per newton at each point [coordinates, rows], m/N. kicks: t·Φ of
        the points [rows, modes]"""
        return np.asarray(product(self.drifts, kicks.T))


def find_factors(
    coordinates: Coordinates, rows: np.ndarray, kick: np.ndarray, drift: np.ndarray, step_rate: float
) -> IslandFactors:
    """Return the factors of the connections of an island, X and Y of f = X·s + Y·g. They solve (1 + D·B)·f = K·s + D·g
    with D = K/2 + R/h, and (B·f)ᵢ = (g + s)ᵢ where rigid.

    rows:        of the coordinates [coordinates, modes]
    kick, drift: t and v of the modes of the island, s
    step_rate:   one over the length of the step, 1/s; 0 if dampers act outside it
    """
    items, unit = coordinates.items, np.eye(len(coordinates.items))
    kicks, drifts = rows * kick, rows * drift
    compliance = product(kicks, drifts.T)
    rigid = np.array([item.is_rigid for item in items])
    held = np.where(rigid, 1 / np.where(rigid, np.diag(compliance), 1.0), 0.0)
    per_extension = coordinates.coupling + np.diag([item.stiffness for item in items] + held)
    damping = np.diag([item.damping * step_rate for item in items])
    per_move = np.where(rigid[:, None], np.diag(held), per_extension / 2 + damping)
    matrix = np.where(rigid[:, None], 0.0, unit) + product(per_move, compliance)
    x, y = np.split(solve(matrix, np.concatenate([per_extension, per_move], axis=1)), 2, axis=1)
    return IslandFactors(compliance, x, y, drifts)


MAX_GAIN = 2.2  # γ² of 14 kHz at 44.1 kHz; higher modes have almost the same effect at all audible frequencies
MAX_SHARE = 0.75  # of the compliance of springs that may be taken from it
MAX_SHARE_LATER = 0.95  # the same where an event makes one harder
MAX_OVERLAP = 0.1  # of the excess compliance that two coordinates share; with more, they do not act independently


class _Rows(NamedTuple):
    """Rows of coordinates over the modes of all their bodies."""

    modes: dict[int, slice]  # by number of the body
    shapes: np.ndarray  # [coordinates, modes], 1/√kg
    modal_compliance: np.ndarray  # 1/ω² [modes], s²
    gain: np.ndarray  # γ² - 1 [modes]

    def scaled(self, share: np.ndarray) -> np.ndarray:
        """Return the rows, each with a share of the gain."""
        return np.asarray(self.shapes * np.sqrt(1 + share[:, None] * self.gain))

    def excess(self, share: np.ndarray) -> np.ndarray:
        """Return the excess compliance of rows that have a share of the gain [coordinates, coordinates], m/N."""
        scaled = self.scaled(share)
        return np.asarray(
            product(scaled * self.modal_compliance, scaled.T)
            - product(self.shapes * self.modal_compliance, self.shapes.T)
        )


def compensate_springs(
    coordinates: Coordinates, may_change: Sequence[bool], omega_of: Callable[[int], np.ndarray], step: float
) -> Coordinates:
    """Return the coordinates of an island with plain springs that give the right frequencies in steps of `step`
    seconds.

    may_change: True for each coordinate that an event may change
    omega_of:   angular frequencies of a body, rad/s; 0 for modes whose shapes must not change
    """
    items = coordinates.items
    rows, alone = _rows(items, omega_of, step), np.array(may_change, dtype=bool)
    damped = np.array([bool(c.damping) or c.is_rigid for c in items])
    plain = (np.array([c.stiffness > 0.0 for c in items]) | alone) & ~damped
    whole = rows.excess(np.ones(len(items)))
    limit = MAX_OVERLAP * np.sqrt(np.outer(np.diag(whole), np.diag(whole)))
    beside = (np.abs(whole) > limit) & ~np.eye(len(items), dtype=bool)
    together = plain & ~alone
    chosen = plain & ~np.any(beside & ~np.outer(together, together), axis=1)
    stiffness = np.array([c.stiffness for c in items])
    share = np.where(chosen, np.minimum(1.0, MAX_SHARE / np.maximum(stiffness * np.diag(whole), MAX_SHARE)), 0.0)
    joint = np.flatnonzero(chosen & together)
    root = np.sqrt(stiffness[joint])
    for _ in range(3):
        excess = rows.excess(share)[np.ix_(joint, joint)]
        held = root[:, None] * excess * root
        if not np.max(np.sum(np.abs(held), axis=1), initial=0.0) > MAX_SHARE:  # a bound of its eigenvalues
            break
        taken = float(symmetric_eigenvectors(held)[0][-1])
        share[joint] *= min(1.0, MAX_SHARE / max(taken, MAX_SHARE))
    excess, scaled = rows.excess(share), rows.scaled(share)
    coupling = coordinates.coupling.copy()
    if joint.size:
        held = root[:, None] * excess[np.ix_(joint, joint)] * root
        coupling[np.ix_(joint, joint)] = root[:, None] * solve(np.eye(joint.size) - held, np.eye(joint.size)) * root
    changed = []
    for i, item in enumerate(items):
        parts = {b: scaled[i, modes] for b, modes in rows.modes.items() if b in item.parts}
        more = float(excess[i, i])
        stiffness_alone = 0.0 if i in joint else stiffness_beside(more, item.stiffness)
        changed.append(item._replace(parts=parts, stiffness=stiffness_alone, excess=more))
    return Coordinates(changed, coupling)


def stiffness_beside(excess: float, stiffness: float) -> float:
    """Return the stiffness (N/m) that acts like `stiffness` (N/m) on rows with an excess compliance of `excess`
    (m/N)."""
    return stiffness / (1 - min(stiffness * excess, MAX_SHARE_LATER))


def _rows(items: Sequence[Coordinate], omega_of: Callable[[int], np.ndarray], step: float) -> _Rows:
    """Return the rows of coordinates, with their gains."""
    bodies = sorted({b for item in items for b in item.parts})
    omega = [omega_of(b) for b in bodies]
    empty = {b: np.zeros(w.size) for b, w in zip(bodies, omega, strict=True)}
    shapes = [np.concatenate([item.parts.get(b, empty[b]) for b in bodies]) for item in items]
    all_omega = np.concatenate(omega)
    angle = np.minimum(all_omega * step, 3.0)
    moving = np.where(all_omega > 0.0, all_omega, 1.0)
    gain = np.where(all_omega > 0.0, np.minimum(angle / sin(np.where(angle > 0.0, angle, 1.0)), MAX_GAIN) - 1, 0.0)
    ends = np.cumsum([0] + [w.size for w in omega]).tolist()
    modes = {b: slice(*ends[n : n + 2]) for n, b in enumerate(bodies)}
    return _Rows(modes, np.array(shapes), np.where(all_omega > 0.0, 1 / square(moving), 0.0), gain)
