"""Linear systems and small decompositions with the same bits on every machine: element by element, in a fixed order."""

import math

import numpy as np

from engine.arithmetic.elementary import square
from engine.arithmetic.products import product

MAX_SWEEPS = 30  # of Jacobi's method, which needs six to ten
ROUNDING = 2.0**-52
DIRECTION = 2.0**-52  # of the longest row: what is shorter is hardly more than rounding


def solve(matrix: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return x with matrix·x = wanted, by Gaussian elimination with partial pivoting (Golub & Van Loan, sec. 3.4).

    matrix: [n, n]; wanted: [n] or [n, columns]. Raises ValueError if the matrix is singular.
    """
    size = len(matrix)
    rows = np.concatenate([matrix, wanted if np.ndim(wanted) == 2 else wanted[:, None]], axis=1)
    for k in range(size):
        best = k + int(np.argmax(np.abs(rows[k:, k])))
        if not abs(rows[best, k]) > 0.0:
            raise ValueError("the matrix is singular")
        if best != k:
            rows[[k, best]] = rows[[best, k]]
        rows[k + 1 :, k:] -= (rows[k + 1 :, k] / rows[k, k])[:, None] * rows[k, k:]
    x = rows[:, size:]
    for k in range(size - 1, -1, -1):
        x[k] /= rows[k, k]
        x[:k] -= rows[:k, k, None] * x[k]
    return np.asarray(x.reshape(np.shape(wanted)))


def rounds_of_pairs(size: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return rounds in which each of so many players meets another one, until all have met: two arrays of players."""
    players = list(range(size + size % 2))
    rounds = []
    for _ in range(len(players) - 1):
        half = len(players) // 2
        pairs = zip(players[:half], players[: half - 1 : -1], strict=True)
        met = [sorted(pair) for pair in pairs if max(pair) < size]
        rounds.append((np.array([a for a, _ in met], np.int64), np.array([b for _, b in met], np.int64)))
        players = [players[0], players[-1], *players[1:-1]]
    return rounds


def _rotation(apart: np.ndarray, both: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cosine and sine of the smaller angle that makes the off-diagonal part `both` of 2 × 2 matrices vanish;
    their diagonals are `apart` from each other (Golub & Van Loan, sec. 8.5.2)."""
    is_zero = both == 0.0
    tau = apart / np.where(is_zero, 1.0, 2.0 * both)
    big = np.abs(tau) > 1e150
    tangent = np.copysign(1.0, tau) / (np.abs(tau) + np.sqrt(1.0 + square(np.where(big, 0.0, tau))))
    tangent = np.where(is_zero, 0.0, np.where(big, 0.5 / np.where(big, tau, 1.0), tangent))
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    return cosine, tangent * cosine


def symmetric_eigenvectors(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return eigenvalues [..., n], rising, and eigenvectors [..., n, n] as columns of symmetric matrices [..., n, n],
    by Jacobi's method. The largest component of each vector is positive."""
    a = np.array(matrices, float)
    size = a.shape[-1]
    if not size:
        return np.zeros(a.shape[:-1]), a
    vectors = np.broadcast_to(np.eye(size), a.shape).copy()
    rounds, off = rounds_of_pairs(size), ~np.eye(size, dtype=bool)
    for _ in range(MAX_SWEEPS):
        if not np.max(np.abs(a * off), initial=0.0) > 0.0:
            break
        for p, q in rounds:
            at_p, at_q, both = a[..., p, p], a[..., q, q], a[..., p, q]
            both = np.where(np.abs(both) > 0.01 * ROUNDING * np.sqrt(np.abs(at_p)) * np.sqrt(np.abs(at_q)), both, 0.0)
            a[..., p, q] = a[..., q, p] = both
            if not both.any():
                continue
            c, s = _rotation(at_q - at_p, both)
            for rows in (np.swapaxes(a, -1, -2), a, np.swapaxes(vectors, -1, -2)):
                first, second = rows[..., p, :], rows[..., q, :]
                rows[..., p, :] = c[..., None] * first - s[..., None] * second
                rows[..., q, :] = s[..., None] * first + c[..., None] * second
            a[..., p, q] = a[..., q, p] = 0.0
    values = np.diagonal(a, axis1=-2, axis2=-1)
    order = np.argsort(values, axis=-1, kind="stable")
    vectors = np.take_along_axis(vectors, order[..., None, :], axis=-1)
    largest = np.argmax(np.abs(vectors), axis=-2)[..., None, :]
    signs = np.copysign(1.0, np.take_along_axis(vectors, largest, axis=-2))
    return np.take_along_axis(values, order, axis=-1), vectors * signs


def singular_vectors(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return U [n, r], s [r], falling, and Vᵀ [r, m] with matrix = U·diag(s)·Vᵀ, by Jacobi's method on the columns of
    its part in each of r directions (Hestenes), those of `span_rows`.

    matrix: [n, m]
    """
    directions = span_rows(matrix)
    columns = np.array(product(directions, matrix.T))  # [r, n], each a column of U·diag(s) after the rotations
    size = len(columns)
    turned = np.eye(size)
    rounds = rounds_of_pairs(size)
    for _ in range(MAX_SWEEPS):
        is_still = True
        for p, q in rounds:
            first, second = columns[p], columns[q]
            pp, qq, pq = (np.add.reduce(x * y, axis=1) for x, y in ((first, first), (second, second), (first, second)))
            both = np.where(np.abs(pq) > ROUNDING * np.sqrt(pp) * np.sqrt(qq), pq, 0.0)
            if not both.any():
                continue
            is_still = False
            c, s = (part[:, None] for part in _rotation(qq - pp, both))
            columns[p], columns[q] = c * first - s * second, s * first + c * second
            first, second = turned[p], turned[q]
            turned[p], turned[q] = c * first - s * second, s * first + c * second
        if is_still:
            break
    singular = np.sqrt(np.add.reduce(columns * columns, axis=1))
    order = np.argsort(-singular, kind="stable")
    left = columns / np.where(singular > 0.0, singular, math.inf)[:, None]
    return left[order].T, singular[order], product(turned[order], directions)


def span_rows(matrix: np.ndarray) -> np.ndarray:
    """Return orthonormal rows [r, m] of which all rows of a matrix [n, m] are sums, but for what is hardly more than
    rounding of the longest row, by Gram and Schmidt's method; of what is left the longest comes first."""
    rest = np.array(matrix, float)
    found: list[np.ndarray] = []
    least = 0.0
    for _ in range(min(rest.shape)):
        lengths = np.add.reduce(rest * rest, axis=1)
        longest = int(np.argmax(lengths))
        if not lengths[longest] > least:
            break
        least = least or square(DIRECTION) * float(lengths[longest])
        row = rest[longest].copy()
        for _ in range(2):  # once more, for what rounding has left
            for other in found:
                row -= np.add.reduce(other * row) * other
        row /= np.sqrt(np.add.reduce(row * row))
        rest -= np.add.reduce(rest * row, axis=1)[:, None] * row
        rest[longest] = 0.0
        found.append(row)
    return np.array(found).reshape(-1, rest.shape[1])
