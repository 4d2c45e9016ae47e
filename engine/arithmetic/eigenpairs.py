"""Lowest eigenvalues and eigenvectors of symmetric matrices, with the same bits on every machine.

LAPACK's differ in their last digits from one processor to another. Here they are a first guess, near enough that one
step of Newton's method, with residuals in twice the digits, leaves errors of 1e-24; rounded to a step of 1e-13, what
differs is gone, but for a chance of less than 1e-6 that some number lies on the border between two steps.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from engine.arithmetic.double_double import two_product
from engine.arithmetic.products import product
from engine.arithmetic.two_parts import (
    SlicedMatrix,
    add_exactly,
    multiply_sliced,
    round_sum,
    slice_matrix,
)

STEP = 2.0**-43  # of the components of vectors, whose largest is below 1, and, relative, of eigenvalues
NEAR = 2.0**-40  # a correction below this leaves none that matters, where no eigenvalue is close
SMALL_STEP, VERY_SMALL = STEP * 2.0**-22, STEP * 2.0**-18  # of vectors with close eigenvalues, before they are rounded
MOST_STEPS = 12  # two or three are usual where eigenvalues are close, one elsewhere
CLOSE, VERY_CLOSE, UNRESOLVED = 1e-3, 1e-8, 1e-22  # relative distances of eigenvalues
CLOSE_BEYOND = 8  # eigenvalues beyond those that are wanted, which may be close to these
FEW_ROWS = 64  # of a triangle that is inverted at once
PANEL = 128  # rows of a triangle that are multiplied at once


class Eigenproblem(NamedTuple):
    """K·v = λ·M·v, of a positive semidefinite K and M = 1 + loads, over the products of functions of some coordinates.

    stiffness: K [functions, functions], symmetric to the last bit, as the loads; shape: numbers of functions of each
    coordinate; loads: coordinates, and matrices of their functions that the mass has in addition, whatever the
    functions of the others are
    """

    stiffness: np.ndarray
    shape: tuple[int, ...]
    loads: Sequence[tuple[int, np.ndarray]] = ()

    def mass(self) -> np.ndarray:
        """M [functions, functions]."""
        size = math.prod(self.shape)
        mass = np.eye(size)
        for axis, load in self.loads:
            before, after = math.prod(self.shape[:axis]), math.prod(self.shape[axis + 1 :])
            blocks = mass.reshape(before, self.shape[axis], after, before, self.shape[axis], after)
            for i in range(before):
                for j in range(after):
                    blocks[i, :, j, i, :, j] += load
        return mass

    def mass_diagonal(self) -> np.ndarray:
        """Diagonal of M [functions]."""
        total = np.ones(self.shape)
        for axis, load in self.loads:
            total += np.diagonal(load).reshape(-1, *(1 for _ in self.shape[axis + 1 :]))
        return total.ravel()

    def multiply_mass(self, vectors: np.ndarray) -> np.ndarray:
        """M·v [functions, vectors]."""
        total = vectors
        for axis, load in self.loads:
            total = total + self.back_from(axis, product(load, self.along(axis, vectors)))
        return total

    def along(self, axis: int, vectors: np.ndarray) -> np.ndarray:
        """Vectors as columns over the functions of one coordinate."""
        rows = np.moveaxis(vectors.reshape(*self.shape, -1), axis, 0)
        return np.ascontiguousarray(rows).reshape(self.shape[axis], -1)

    def back_from(self, axis: int, rows: np.ndarray) -> np.ndarray:
        """The vectors of which `along` made such columns."""
        others = self.shape[:axis] + self.shape[axis + 1 :]
        return np.moveaxis(rows.reshape(self.shape[axis], *others, -1), 0, axis).reshape(math.prod(self.shape), -1)


class Guess(NamedTuple):
    """All eigenpairs, but for their last digits, of the problem with functions that are scaled by powers of two."""

    values: np.ndarray  # λ, rising
    rests: np.ndarray  # of λ beyond these digits
    shift: float
    scale: np.ndarray  # of the functions
    stiffness: np.ndarray  # K of the scaled functions
    inverse: np.ndarray  # of the lower triangle of K + shift·M
    turned: np.ndarray  # orthonormal columns: the vectors are inverseᵀ·turned·√(λ + shift)


def guess_eigenpairs(problem: Eigenproblem, shift: float) -> Guess:
    """Eigenpairs by LAPACK, as the largest 1/(λ + shift): so rounding is small against the low ones.

    shift: near the geometric mean of those that are wanted
    """
    scale, stiffness, inverse, reduced = _reduce(problem, shift)
    large, turned = np.linalg.eigh(reduced)
    return Guess(_values_of(large, shift), np.zeros(large.size), shift, scale, stiffness, inverse, turned[:, ::-1])


def guess_eigenvalues(problem: Eigenproblem, shift: float) -> np.ndarray:
    """Eigenvalues, rising; their last digits differ by machine."""
    return _values_of(np.linalg.eigvalsh(_reduce(problem, shift)[-1]), shift)


def _values_of(large: np.ndarray, shift: float) -> np.ndarray:
    """λ, rising, of 1/(λ + shift), rising."""
    with np.errstate(divide="ignore"):
        return np.asarray(1 / np.maximum(large[::-1], 0.0) - shift)


def _reduce(problem: Eigenproblem, shift: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Scale of the functions, K of these, inverse of the triangle of K + shift·M, and the lower triangle of M there."""
    diagonal = np.diagonal(problem.stiffness) + shift * problem.mass_diagonal()
    scale = np.ldexp(1.0, -(np.frexp(diagonal)[1] // 2))
    stiffness = problem.stiffness * scale[:, None] * scale
    if problem.loads:
        inverse = _invert_triangle(np.linalg.cholesky(stiffness + shift * (problem.mass() * scale[:, None] * scale)))
    else:
        inverse = _invert_triangle(np.linalg.cholesky(stiffness + np.diag(shift * scale * scale)))
    rows = inverse * scale
    heavy = rows.T.copy()
    for axis, load in problem.loads:
        heavy += problem.back_from(axis, load @ problem.along(axis, rows.T))
    reduced = np.zeros_like(rows)  # of its lower triangle, as LAPACK asks for; rows is a triangle, too
    for begin, end in pairwise(range(0, len(rows) + PANEL, PANEL)):
        reduced[begin:end, :end] = rows[begin:end, :end] @ heavy[:end, :end]
    return scale, stiffness, inverse, reduced


def _invert_triangle(lower: np.ndarray) -> np.ndarray:
    size = lower.shape[0]
    if size <= FEW_ROWS:
        return np.asarray(np.tril(np.linalg.inv(lower)))
    half = size // 2
    out = np.zeros_like(lower)
    out[:half, :half] = _invert_triangle(lower[:half, :half])
    out[half:, half:] = _invert_triangle(lower[half:, half:])
    out[half:, :half] = -out[half:, half:] @ (lower[half:, :half] @ out[:half, :half])
    return out


def refine_eigenpairs(problem: Eigenproblem, guess: Guess, begin: int, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues from number `begin` up to `end`, and their vectors with vᵀ·M·v = 1, with the same bits everywhere.

    A vector changes by the other vectors, each by its part of the residual over the distance of the eigenvalues. Its
    scale is such that the first component of at least half the largest, of the scaled functions, is ½. Two eigenvalues
    that are the same to 1e-20 have no vectors of their own, and LAPACK's choice stays.
    """
    residuals = _Residuals(problem, guess)
    guess, near = _part_close_pairs(residuals, guess, begin, end)
    vectors, first = _scaled_vectors(guess, slice(begin, end))
    small = np.zeros_like(vectors)  # of vectors with close eigenvalues, whose residuals must be smaller
    values, rests = guess.values.copy(), guess.rests.copy()
    active = np.arange(end - begin)
    for _ in range(MOST_STEPS):
        if not active.size:
            break
        which = begin + active
        value, of_active = values[which], vectors[:, active]
        rest, heavy = residuals.of(of_active, small[:, active], value)
        more = np.add.reduce(of_active * rest, axis=0) / np.add.reduce(of_active * heavy, axis=0)
        rest -= more * heavy  # none of it along the vector itself: LAPACK's others are not quite orthogonal to it
        change = small[:, active] + _solve(guess, (values, rests), which, rest)
        change -= of_active * (2 * change[first[active], np.arange(active.size)])
        moved = of_active + change
        more += np.add.reduce(moved * rest, axis=0) / np.add.reduce(moved * heavy, axis=0)
        values[which] = round_sum(value, more, STEP * np.ldexp(1.0, np.frexp(value)[1]))
        rests[which] = (value - values[which]) + more
        is_small = np.max(np.abs(change), axis=0) < NEAR
        unsettled = is_small & near[active] & (np.max(np.abs(change - small[:, active]), axis=0) > VERY_SMALL)
        small[:, active] = np.where(unsettled, np.rint(change / SMALL_STEP) * SMALL_STEP, 0.0)
        vectors[:, active] = np.where(unsettled, of_active, round_sum(of_active, change, STEP))
        active = active[unsettled | ~is_small]
    vectors *= guess.scale[:, None]
    size = np.sqrt(np.add.reduce(vectors * problem.multiply_mass(vectors), axis=0))
    return values[begin:end], vectors / size


def _scaled_vectors(guess: Guess, which: slice) -> tuple[np.ndarray, np.ndarray]:
    """Some vectors, of multiples of STEP, and for each the component that is ½."""
    vectors = guess.inverse.T @ guess.turned[:, which]
    first = np.argmax(np.abs(vectors) >= 0.5 * np.max(np.abs(vectors), axis=0), axis=0)
    return np.rint(vectors * (0.5 / STEP / vectors[first, np.arange(first.size)])) * STEP, first


def _part_close_pairs(residuals: "_Residuals", guess: Guess, begin: int, end: int) -> tuple[Guess, np.ndarray]:
    """The guess with those vectors turned whose eigenvalues LAPACK cannot tell apart, and which have close ones.

    In the space of these vectors, K - λ·M is so small that the small problem there has all its digits.
    """
    values = guess.values[begin : end + CLOSE_BEYOND]
    apart = np.diff(values) / (values[:-1] + guess.shift)
    near = np.zeros(end - begin, bool)
    for k in np.flatnonzero(apart < CLOSE):
        near[k : k + 2] = True
    borders = np.flatnonzero(np.concatenate([[True], ~(apart < VERY_CLOSE), [True]])) + begin
    groups = [slice(a, b) for a, b in pairwise(borders.tolist()) if b - a > 1 and a < end]
    if not groups:
        return guess, near
    values, rests, turned = guess.values.copy(), guess.rests.copy(), guess.turned.copy()
    for group in groups:
        vectors, _ = _scaled_vectors(guess, group)
        middle = float(np.mean(values[group]))
        rest, heavy = residuals.of(vectors, np.zeros_like(vectors), np.full(vectors.shape[1], middle))
        small, mass = vectors.T @ rest, vectors.T @ heavy
        upper = np.linalg.inv(np.linalg.cholesky((mass + mass.T) / 2)).T
        rests[group], mixture = np.linalg.eigh(upper.T @ (small + small.T) @ upper / 2)
        values[group] = middle
        sizes = np.max(np.abs(guess.inverse.T @ turned[:, group]), axis=0) / np.max(np.abs(vectors), axis=0)
        signs = np.sign(np.add.reduce((guess.inverse.T @ turned[:, group]) * vectors, axis=0))
        mixed = (turned[:, group] / (sizes * signs)) @ (upper @ mixture)
        turned[:, group] = mixed / np.linalg.norm(mixed, axis=0)
    return guess._replace(values=values, rests=rests, turned=turned), near


def _solve(guess: Guess, values: tuple[np.ndarray, np.ndarray], which: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Changes of vectors, sums of the others, with which their residuals vanish.

    values: λ of all vectors, in two parts
    """
    shares = guess.turned.T @ (guess.inverse @ rest)
    whole, small = values
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = (whole[which] - whole[:, None]) + (small[which] - small[:, None])
        factor = np.where(np.isinf(apart), -1.0, (whole[:, None] + guess.shift) / apart)
    close = np.abs(apart) <= UNRESOLVED * np.abs(whole[which] + guess.shift)
    close[which, np.arange(which.size)] = True
    return np.asarray(guess.inverse.T @ (guess.turned @ np.where(close, 0.0, factor * shares)))


class _Residuals:
    """K·v - λ·M·v of the scaled functions, in twice the digits."""

    def __init__(self, problem: Eigenproblem, guess: Guess) -> None:
        self.problem, self.scale = problem, guess.scale[:, None]
        self.stiffness = slice_matrix(guess.stiffness)
        self.loads: list[tuple[int, SlicedMatrix]] = [(axis, slice_matrix(load)) for axis, load in problem.loads]

    def of(self, vectors: np.ndarray, small: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The residuals of the sums of two vectors, and M·v [functions, vectors]."""
        total, lost, heavy = self.in_parts(vectors, values)
        has_small = small.any(axis=0)
        if has_small.any():
            more, lost_there, _ = self.in_parts(small[:, has_small], values[has_small])
            total[:, has_small], missing = add_exactly(total[:, has_small], more)
            lost[:, has_small] += missing + lost_there
        return total + lost, heavy

    def in_parts(self, vectors: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The residuals in two parts, and M·v."""
        bent, rest_of_bent = multiply_sliced(self.stiffness, vectors)
        plain = self.scale * vectors
        heavy, rest_of_heavy = plain, np.zeros_like(plain)
        for axis, load in self.loads:
            more, rest = (
                self.problem.back_from(axis, part) for part in multiply_sliced(load, self.problem.along(axis, plain))
            )
            heavy, lost = add_exactly(heavy, more)
            rest_of_heavy = rest_of_heavy + lost + rest
        heavy, rest_of_heavy = heavy * self.scale, rest_of_heavy * self.scale
        inertia, rest_of_inertia = two_product(heavy, values)
        total, lost = add_exactly(bent, -inertia)
        return total, lost + (rest_of_bent - (rest_of_inertia + rest_of_heavy * values)), heavy
