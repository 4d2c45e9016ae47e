"""Functions of one side of a plate, or of the height of a shell, of whose products modes are made."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np

Edge = Literal["supported", "clamped", "free"]

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
        t, weight = np.polynomial.legendre.leggauss(polynomials + 3)
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
        f = self.values(x, 3)
        return np.asarray(np.einsum("dxi,x,exj->deij", f, weight, f, optimize=True))

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
            rest = cubic @ pairs
            size = np.linalg.norm(rest, axis=0)
            share = smooth.T @ rest
            rest -= smooth @ share
            remainder = smooth.T @ rest  # what rounding left
            rest, share = rest - smooth @ remainder, share + remainder
            norm = np.linalg.norm(rest, axis=0)
            keep = norm > 1e-13 * size  # at an edge it is a polynomial
            rest, norm, share, pairs = rest[:, keep], norm[keep], share[:, keep], pairs[:, keep]
            value, vector = np.linalg.eigh(rest.T @ rest / norm / norm[:, None])
            keep = value > 1e-9
            turn = vector[:, keep] / np.sqrt(value[keep]) / norm[:, None]
            new = np.concatenate([-share @ turn, pairs @ turn])
            old = np.concatenate([self.mixture, np.zeros((new.shape[0] - self.mixture.shape[0], self.odd.size))])
            self.mixture = np.concatenate([old, new], axis=1)
            self.odd = np.concatenate([self.odd, np.full(turn.shape[1], sign)])

    def values(self, x: np.ndarray, derivatives: int = 1) -> np.ndarray:
        """The functions and their derivatives, [derivatives, *x.shape, functions]."""
        smooth = self.smooth_functions(x, derivatives)
        if not self.places.size:
            return smooth
        return np.asarray(np.concatenate([smooth, self.cubics(x, derivatives)], axis=-1) @ self.mixture)

    def smooth_functions(self, x: np.ndarray, derivatives: int) -> np.ndarray:
        """The polynomials and their derivatives, [derivatives, *x.shape, polynomials].

        Recurrence of the orthonormal Jacobi polynomials: Gautschi, Orthogonal Polynomials, table 1.1.
        """
        q, p = self.powers
        alpha, beta, both = 2 * p, 2 * q, 2 * p + 2 * q
        t = 2 * x - 1
        k = np.arange(1.0, self.polynomials + 1)
        middle = 2 * k + both
        off = np.sqrt(4 * k * (k + alpha) * (k + beta) * (k + both) / (middle**2 * (middle**2 - 1)))
        centre = np.zeros(k.size)
        if p != q:
            centre = (beta**2 - alpha**2) / ((middle - 2) * middle)
        mass = 2.0**both * math.factorial(alpha) * math.factorial(beta) / math.factorial(both + 1)
        f = np.zeros((self.polynomials, derivatives, *x.shape))  # derivatives with respect to t
        f[0, 0] = 1 / math.sqrt(mass)
        order = np.arange(derivatives).reshape(-1, *(1 for _ in x.shape))
        for i in range(self.polynomials - 1):
            f[i + 1] = (t - centre[i]) * f[i]
            f[i + 1, 1:] += order[1:] * f[i, :-1]
            if i:
                f[i + 1] -= off[i - 1] * f[i - 1]
            f[i + 1] /= off[i]
        factor = np.polynomial.Polynomial([1, -1]) ** p * np.polynomial.Polynomial([1, 1]) ** q
        out = np.empty((derivatives, *x.shape, self.polynomials))
        for d in range(derivatives):  # Leibniz
            terms = (math.comb(d, j) * factor.deriv(d - j)(t) * f[:, j] for j in range(d + 1))
            out[d] = 2.0**d * np.moveaxis(sum(terms, np.zeros(1)), 0, -1)
        return out

    def cubics(self, x: np.ndarray, derivatives: int) -> np.ndarray:
        """|x - r|³ less the polynomial that has its values and slopes at the ends where shapes may have none."""
        far = x[..., None] - self.places
        out = np.stack([np.abs(far) ** 3, 3 * far * np.abs(far), 6 * np.abs(far)][:derivatives])
        conditions = [(end, d) for end, power in zip((0.0, 1.0), self.powers, strict=True) for d in range(power)]
        if not conditions:
            return out
        powers = [np.polynomial.Polynomial.basis(j) for j in range(len(conditions))]
        rows = np.array([[power.deriv(d)(end) for power in powers] for end, d in conditions])
        distance = {end: np.abs(end - self.places) for end in (0.0, 1.0)}
        wanted = [distance[end] ** 3 if d == 0 else 3 * (end - self.places) * distance[end] for end, d in conditions]
        factors = np.linalg.solve(rows, np.array(wanted))
        for d in range(derivatives):
            out[d] -= np.stack([power.deriv(d)(x) for power in powers], axis=-1) @ factors
        return out
