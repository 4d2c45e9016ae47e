"""Factors of connection forces in a step, when a scene is built; engine.kernel.interactions.connection_factors computes
them again after a change."""

from typing import NamedTuple

import numpy as np

from engine.assembly.coordinates import Coordinates


class IslandFactors(NamedTuple):
    """Factors of the connections of an island in a step."""

    compliance: np.ndarray  # B [coordinates, coordinates]
    per_extension: np.ndarray  # X
    per_move: np.ndarray  # Y
    kicks: np.ndarray  # t·rows [coordinates, modes]
    drifts: np.ndarray  # v·rows

    def reduce(self, shapes: np.ndarray, kick: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Return the compliance [rows, rows] of points with the given mode shapes while connections act. `matrix` is
        their compliance without connections."""
        moves = self.contact_moves(shapes, kick)
        return np.asarray(matrix - moves.T @ self.per_move @ moves)

    def contact_moves(self, shapes: np.ndarray, kick: np.ndarray) -> np.ndarray:
        """Return the displacement of each coordinate per newton at each point [coordinates, rows], m/N."""
        return np.asarray(self.drifts @ (shapes * kick).T)


def find_factors(coordinates: Coordinates, compliance: np.ndarray, step_rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return X and Y of f = X·s + Y·g. They solve (1 + D·B)·f = K·s + D·g with D = K/2 + R/h, and (B·f)ᵢ = (g + s)ᵢ
    where rigid."""
    items, unit = coordinates.items, np.eye(len(coordinates.items))
    rigid = np.array([item.is_rigid for item in items])
    held = np.where(rigid, 1 / np.where(rigid, np.diag(compliance), 1.0), 0.0)
    per_extension = coordinates.coupling + np.diag([item.stiffness for item in items] + held)
    damping = np.diag([item.damping * step_rate for item in items])
    per_move = np.where(rigid[:, None], np.diag(held), per_extension / 2 + damping)
    matrix = np.where(rigid[:, None], 0.0, unit) + per_move @ compliance
    return np.linalg.solve(matrix, per_extension), np.linalg.solve(matrix, per_move)
