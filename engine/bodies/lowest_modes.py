"""The lowest modes of bodies whose motion is a sum of functions, by the Rayleigh-Ritz method."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from engine.arithmetic.eigenpairs import Eigenproblem, guess_eigenpairs, guess_eigenvalues, refine_eigenpairs
from engine.arithmetic.products import product

ROUNDING = 1e-9  # relative, of an eigenvalue that is not refined


class Block(NamedTuple):
    """Modes of one symmetry."""

    problem: Eigenproblem
    rigid: Sequence[int]  # functions that span the motions of ω = 0


def lowest_modes(
    blocks: Sequence[Block], shift: float, count: int, max_omega: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Squares of the lowest angular frequencies of each block, and vectors [functions, modes] of modal mass 1.

    shift: near the geometric mean of the squares; count: of all blocks, which find no more, but for some of the same
    frequency as the last
    """
    guesses = [guess_eigenpairs(block.problem, shift) for block in blocks]
    values = np.sort(np.concatenate([guess.values for guess in guesses]))
    last = min(float(values[min(count, values.size) - 1]), max_omega * max_omega)
    last += ROUNDING * (last + shift)
    pairs = []
    for (problem, rigid), guess in zip(blocks, guesses, strict=True):
        still = rigid_vectors(problem, rigid)
        end = max(len(rigid), int(np.searchsorted(guess.values, last)))
        square, vectors = refine_eigenpairs(problem, guess, len(rigid), end)
        square = np.concatenate([np.zeros(len(rigid)), np.maximum(square, 0.0)])
        pairs.append((square, np.concatenate([still, vectors], axis=1)))
    return pairs


def estimate_highest(blocks: Sequence[Block], shift: float, count: int) -> float:
    """Square of the highest of so many lowest angular frequencies, to 16 bits: what differs by machine is hidden."""
    values = np.sort(np.concatenate([guess_eigenvalues(block.problem, shift) for block in blocks]))
    digits, exponent = math.frexp(values[count - 1])
    return math.ldexp(float(round(math.ldexp(digits, 16))), exponent - 16)


def rigid_vectors(problem: Eigenproblem, rigid: Sequence[int]) -> np.ndarray:
    """Motions of some functions, made orthonormal one after the other [functions, motions]."""
    size = problem.stiffness.shape[0]
    basis = np.zeros((size, 0))
    for j in rigid:
        vector = np.zeros((size, 1))
        vector[j] = 1.0
        vector -= product(basis, product(basis.T, problem.multiply_mass(vector)))
        square = np.add.reduce(vector * problem.multiply_mass(vector), axis=0)
        basis = np.concatenate([basis, vector / np.sqrt(square)], axis=1)
    return basis


def symmetric(matrix: np.ndarray) -> np.ndarray:
    """A matrix without what rounding made of its symmetry."""
    return np.asarray((matrix + matrix.T) / 2)


def with_signs(vectors: np.ndarray) -> np.ndarray:
    """Vectors whose first component of at least half the largest is positive."""
    if not vectors.size:
        return vectors
    large = np.argmax(np.abs(vectors) >= 0.5 * np.max(np.abs(vectors), axis=0), axis=0)
    return np.asarray(vectors * np.sign(vectors[large, np.arange(vectors.shape[1])]))
