"""Pairs of points on a body that stretches. A rise of its tension changes how far a force at one moves the other
(engine.kernel.interactions.stretched_compliance)."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from engine.assembly.layout import Layout
from engine.assembly.mode_shape_rows import ShapeRow, mode_shape_rows
from engine.kernel.data.enums import PairOnBody, StiffenedMatrix
from engine.kernel.data.model import Stiffening


class BodyPairs(NamedTuple):
    """Points on a body that stretches, and pairs of these."""

    rows: list[ShapeRow]  # of the points
    pairs: np.ndarray  # [pairs, len(PairOnBody)]; the shapes are those of the rows, by number
    matrix: np.ndarray  # [pairs], StiffenedMatrix of each


def stiffening(layout: Layout, bodies: Sequence[int]) -> Stiffening:
    """Return the pairs of contacts and coordinates of connections on bodies, by their numbers in the scene."""
    rows, pairs, begins = list[ShapeRow](), list[np.ndarray](), list[list[int]]()
    for n in range(len(layout.islands.bodies)):
        of_island, matrices = [np.zeros((0, len(PairOnBody)), np.int64)], [np.zeros(0, np.int64)]
        for body in _bodies_with_points(layout, n, bodies):
            shifted = body.pairs.copy()
            shifted[:, [PairOnBody.SHAPE, PairOnBody.OTHER_SHAPE]] += len(rows)
            rows += body.rows
            of_island.append(shifted)
            matrices.append(body.matrix)
        matrix = np.concatenate(matrices)
        pairs.append(np.concatenate(of_island)[np.argsort(matrix, kind="stable")])
        begins.append([int(np.sum(matrix < kind)) for kind in range(len(StiffenedMatrix) + 1)])
    placed, joined = mode_shape_rows(rows), np.concatenate(pairs)
    for column in (PairOnBody.SHAPE, PairOnBody.OTHER_SHAPE):
        joined[:, column] = placed.offset[joined[:, column]]
    return Stiffening(joined, np.array(begins, np.int64), placed.phi)


def count_pairs(layout: Layout, bodies: Sequence[int]) -> list[int]:
    """Return how many pairs of points each island has on bodies that stretch."""
    return [
        sum(len(body.pairs) for body in _bodies_with_points(layout, n, bodies))
        for n in range(len(layout.islands.bodies))
    ]


def _bodies_with_points(layout: Layout, island: int, bodies: Sequence[int]) -> Iterator[BodyPairs]:
    """Yield the points on each body of an island that stretches, and their pairs."""
    points, modes = layout.points, layout.modes
    contacts = points.contact_shapes[island].phi
    shapes = np.concatenate([contacts, points.coordinate_rows[island]])
    order = [b for b in layout.islands.body_order if layout.islands.of_body[b] == island]
    for place, b in enumerate(order):
        if b in bodies:
            inside = modes.in_island[b]
            on = np.flatnonzero(shapes[:, inside].any(axis=1))
            rows = [ShapeRow(inside.start, modes.of_body[b].start, shapes[k, inside]) for k in on]
            first, second = np.tril_indices(len(on))
            i, j = on[first], on[second]
            pairs = np.zeros((len(i), len(PairOnBody)), np.int64)
            pairs[:, PairOnBody.BODY], pairs[:, PairOnBody.MODE_BEGIN] = place, inside.start
            pairs[:, PairOnBody.MODES] = inside.stop - inside.start
            pairs[:, PairOnBody.SHAPE], pairs[:, PairOnBody.OTHER_SHAPE] = first, second
            places = _places(i, j, len(contacts), len(shapes) - len(contacts))
            pairs[:, PairOnBody.TARGET], pairs[:, PairOnBody.MIRROR], matrix = places
            yield BodyPairs(rows, pairs, matrix)


def _places(i: np.ndarray, j: np.ndarray, contacts: int, connections: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the entries of pairs are in their matrix, once more if it is symmetric or -1, and which matrix it is
    (StiffenedMatrix). i, j: numbers of points, i >= j; contacts come first"""
    size = np.where(j < contacts, contacts, connections)
    a, b = np.where(j < contacts, i, i - contacts), np.where(j < contacts, j, j - contacts)
    is_mixed = (i >= contacts) & (j < contacts)
    target = np.where(is_mixed, j * connections + i - contacts, a * size + b)
    mirror = np.where(is_mixed | (i == j), -1, b * size + a)
    unmixed = np.where(j < contacts, StiffenedMatrix.CONTACTS, StiffenedMatrix.CONNECTIONS)
    matrix = np.where(is_mixed, StiffenedMatrix.CONTACT_MOVES, unmixed)
    return target, mirror, matrix
