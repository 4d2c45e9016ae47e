"""Functions of one side of a plate, or of the height of a shell, of whose products modes are made."""

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from engine.arithmetic.elementary import square
from engine.arithmetic.linear import symmetric_eigenvectors
from engine.arithmetic.products import product
from engine.arithmetic.quadrature import gauss_legendre

Edge = Literal["supported", "clamped", "free"]

MOST_DERIVATIVES = 3  # from the 0th
POWERS: dict[Edge, int] = {"free": 0, "supported": 1, "clamped": 2}  # of the distance from an edge in all shapes


class SideFunctions:
    """Functions of one coordinate, a fraction of a side, orthonormal from 0 to 1, that vanish as the ends want.

    They are (1 - x)^p·x^q·(Jacobi polynomials of weight (1 - x)^2p·x^2q), and that of the cubics |x - r|³ at the
    places r of ribs which is orthogonal to these.
    """

    def __init__(self, ends: tuple[Edge, Edge], polynomials: int, places: Sequence[float]) -> None:
        self.powers = POWERS[ends[0]], POWERS[ends[1]]
        self.polynomials = polynomials
        self.places = np.unique(np.array(places, float))
        mirrored = bool(np.allclose(self.places, 1 - self.places[::-1], rtol=0, atol=1e-12))
        self.has_parity = ends[0] == ends[1] and mirrored
        self.odd = np.arange(polynomials) % 2 * self.has_parity  # [functions], 1 where f(1 - x) = -f(x)
        t, weight = gauss_legendre(polynomials + 3)
        borders = np.unique(np.concatenate([[0.0, 1.0], self.places]))
        width = np.diff(borders)[:, None] / 2
        x, weight = (borders[:-1, None] + width * (1 + t)).ravel(), (width * weight).ravel()
        self.mixture = np.eye(polynomials)  # [polynomials and cubics, functions]
        if self.places.size:
            self.add_cubics(x, weight)
        self.quadrature = x, weight

    @cached_property
    def integrals(self) -> np.ndarray:
        """Of products of the derivatives d and e of two functions, [d, e, functions, functions]."""
        x, weight = self.quadrature
        f = np.sqrt(weight)[:, None] * self.values(x, 3)
        side_by_side = np.moveaxis(f, 0, 1).reshape(x.size, -1)
        return np.moveaxis(product(side_by_side.T, side_by_side).reshape(3, -1, 3, f.shape[-1]), 1, 2)

    def add_cubics(self, x: np.ndarray, weight: np.ndarray) -> None:
        """Adds what the cubics have beyond the polynomials, by quadrature with points x and weights."""
        number = self.places.size
        mirror = np.eye(number)[::-1]
        half = number // 2
        even, odd = (np.eye(number) + mirror)[:, : number - half], (np.eye(number) - mirror)[:, :half]
        root = np.sqrt(weight)[:, None]
        smooth = root * self.smooth_functions(x, 1)[0]
        cubic = root * self.cubics(x, 1)[0]
        for sign, pairs in ((0, even), (1, odd)) if self.has_parity else ((0, np.eye(number)),):
            rest = product(cubic, pairs)
            size = norms(rest)
            share = product(smooth.T, rest)
            rest -= product(smooth, share)
            remainder = product(smooth.T, rest)  # what rounding left
            rest, share = rest - product(smooth, remainder), share + remainder
            norm = norms(rest)
            keep = norm > 1e-13 * size  # at an edge it is a polynomial
            rest, norm, share, pairs = rest[:, keep], norm[keep], share[:, keep], pairs[:, keep]
            value, vector = symmetric_eigenvectors(product(rest.T, rest) / norm / norm[:, None])
            keep = value > 1e-9
            turn = vector[:, keep] / np.sqrt(value[keep]) / norm[:, None]
            new = np.concatenate([-product(share, turn), product(pairs, turn)])
            old = np.concatenate([self.mixture, np.zeros((new.shape[0] - self.mixture.shape[0], self.odd.size))])
            self.mixture = np.concatenate([old, new], axis=1)
            self.odd = np.concatenate([self.odd, np.full(turn.shape[1], sign)])

    def values(self, x: np.ndarray, derivatives: int = 1) -> np.ndarray:
        """The functions and their derivatives, [derivatives, *x.shape, functions]."""
        smooth = self.smooth_functions(x, derivatives)
        if not self.places.size:
            return smooth
        both = np.concatenate([smooth, self.cubics(x, derivatives)], axis=-1)
        return np.concatenate([smooth, product(both, self.mixture[:, self.polynomials :])], axis=-1)

    def smooth_functions(self, x: np.ndarray, derivatives: int) -> np.ndarray:
        """The polynomials and their derivatives, [derivatives, *x.shape, polynomials].

        Recurrence of the orthonormal Jacobi polynomials: Gautschi, Orthogonal Polynomials, table 1.1.
        """
        q, p = self.powers
        alpha, beta, both = 2 * p, 2 * q, 2 * p + 2 * q
        t = 2 * x - 1
        k = np.arange(1.0, self.polynomials + 1)
        middle = 2 * k + both
        off = np.sqrt(4 * k * (k + alpha) * (k + beta) * (k + both) / (square(middle) * (square(middle) - 1)))
        centre = np.zeros(k.size)
        if p != q:
            centre = (beta * beta - alpha * alpha) / ((middle - 2) * middle)
        mass = math.ldexp(1.0, both) * math.factorial(alpha) * math.factorial(beta) / math.factorial(both + 1)
        f = np.zeros((self.polynomials, derivatives, *x.shape))  # derivatives with respect to t
        f[0, 0] = 1 / math.sqrt(mass)
        order = np.arange(derivatives).reshape(-1, *(1 for _ in x.shape))
        for i in range(self.polynomials - 1):
            f[i + 1] = (t - centre[i]) * f[i]
            f[i + 1, 1:] += order[1:] * f[i, :-1]
            if i:
                f[i + 1] -= off[i - 1] * f[i - 1]
            f[i + 1] /= off[i]
        factors = factors_at_ends(p, q)
        out = np.empty((derivatives, *x.shape, self.polynomials))
        for d in range(derivatives):  # Leibniz
            terms = (math.comb(d, j) * sum_powers(factors[d - j], t) * f[:, j] for j in range(d + 1))
            out[d] = math.ldexp(1.0, d) * np.moveaxis(sum(terms, np.zeros(1)), 0, -1)
        return out

    def cubics(self, x: np.ndarray, derivatives: int) -> np.ndarray:
        """|x - r|³ less the polynomial that has its values and slopes at the ends where shapes may have none."""
        far = x[..., None] - self.places
        size = np.abs(far)
        out = np.stack([size * size * size, 3 * far * size, 6 * size][:derivatives])
        conditions = [(end, d) for end, power in zip((0.0, 1.0), self.powers, strict=True) for d in range(power)]
        if not conditions:
            return out
        distance = {end: np.abs(end - self.places) for end in (0.0, 1.0)}
        wanted = [
            distance[end] * distance[end] * (distance[end] if d == 0 else 3 * np.sign(end - self.places))
            for end, d in conditions
        ]
        factors = product(polynomials_of_ends(*self.powers), np.array(wanted))  # [powers of x, places]
        for d in range(derivatives):
            out[d] -= sum_powers(factors, x[..., None])
            factors = np.arange(1.0, len(factors))[:, None] * factors[1:]
        return out


def sum_powers(factors: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A polynomial, or several [powers, polynomials], the lowest power first, at x."""
    total = np.zeros_like(x)
    for factor in factors[::-1]:
        total = total * x + factor
    return total


@lru_cache
def factors_at_ends(p: int, q: int) -> list[np.ndarray]:
    """(1 - t)^p·(1 + t)^q and its derivatives, the lowest power first."""
    factor = np.ones(1)
    for step in [-1.0] * p + [1.0] * q:
        factor = np.append(factor, 0.0) + step * np.append(0.0, factor)
    out = [factor]
    while len(out) < MOST_DERIVATIVES:
        out.append(np.arange(1.0, out[-1].size) * out[-1][1:])
    return out


@lru_cache
def polynomials_of_ends(at_0: int, at_1: int) -> np.ndarray:
    """Polynomials of x, as columns, the lowest power first, of which each has one value or slope of 1 at x = 0 or 1:
    of so many derivatives, from the 0th, at 0 and at 1, the others are 0."""
    count = at_0 + at_1
    rows = np.zeros((count, count))
    for d in range(at_0):
        rows[d, d] = math.factorial(d)
    for d in range(at_1):
        rows[at_0 + d] = [math.perm(j, d) for j in range(count)]
    return np.asarray(np.rint(np.linalg.inv(rows)) + 0.0)  # whole numbers: the determinant is 1


def norms(columns: np.ndarray) -> np.ndarray:
    """Length of each column."""
    return np.asarray(np.sqrt(np.add.reduce(np.square(columns), axis=0)))
