"""Gauss collocation in extended precision: nodes, and the integrals of the polynomials through them, on [0, 1]."""

from functools import cache
from typing import NamedTuple

import numpy as np

Real = np.longdouble


class Nodes(NamedTuple):
    """Gauss nodes on [0, 1], and linear maps of values at them. Extended precision."""

    place: np.ndarray  # [nodes]
    share: np.ndarray  # [nodes], integral from 0 to 1
    integral: np.ndarray  # [nodes, nodes], integrals from 0 to each node
    finer: np.ndarray  # [finer], places from 0 to 1, both with
    finer_integral: np.ndarray  # [finer, nodes], integrals from 0 to each of them
    finer_value: np.ndarray  # [finer, nodes], values at them
    last: np.ndarray  # [2, nodes], the last two Legendre coefficients


def legendre_values(count: int, place: np.ndarray) -> np.ndarray:
    """Legendre polynomials of degree 0 … count - 1 at places on [0, 1]: [places, count]"""
    x = 2 * np.atleast_1d(place) - 1
    values = [np.ones_like(x), x]
    for n in range(1, count):
        values.append(((2 * n + 1) * x * values[n] - n * values[n - 1]) / Real(n + 1))
    return np.stack(values[:count], axis=1)


def legendre_integrals(count: int, place: np.ndarray) -> np.ndarray:
    """Integrals from 0 of the same: [places, count]"""
    values = legendre_values(count + 1, place)
    odd = 2 * np.arange(1, count) + 1
    rest = (values[:, 2:] - values[:, :-2]) / odd.astype(Real) / 2
    return np.concatenate([np.atleast_1d(place)[:, None], rest], axis=1)


@cache
def gauss_places(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of Gauss nodes on [0, 1], and their shares of an integral: [nodes] each"""
    x = (np.polynomial.legendre.leggauss(count)[0].astype(Real) + 1) / 2
    for _ in range(3):  # Newton's method, from double precision on
        x = x - legendre_values(count + 1, x)[:, count] / _slope(count, x) / 2
    return x, 1 / (4 * x * (1 - x) * _slope(count, x) ** 2)


def _slope(count: int, place: np.ndarray) -> np.ndarray:
    """Derivative of a Legendre polynomial by 2·place - 1: [places]"""
    z, values = 2 * place - 1, legendre_values(count + 1, place)
    return np.asarray(count * (z * values[:, count] - values[:, count - 1]) / (z * z - 1))


@cache
def coefficients(count: int) -> np.ndarray:
    """Legendre coefficients of values at the nodes: [degree, nodes]"""
    place, share = gauss_places(count)
    return (2 * np.arange(count) + 1).astype(Real)[:, None] * legendre_values(count, place).T * share


@cache
def gauss_nodes(count: int) -> Nodes:
    """The nodes of a count."""
    place, share = gauss_places(count)
    finer = np.linspace(0, 1, 3 * count + 1).astype(Real)
    return Nodes(
        place=place,
        share=share,
        integral=integral_to(count, place),
        finer=finer,
        finer_integral=integral_to(count, finer),
        finer_value=value_at(count, finer),
        last=coefficients(count)[-2:],
    )


def integral_to(count: int, place: np.ndarray) -> np.ndarray:
    """Integrals from 0 to places of values at the nodes: [places, nodes]"""
    return np.asarray(legendre_integrals(count, place) @ coefficients(count))


def value_at(count: int, place: np.ndarray) -> np.ndarray:
    """Values at places of the polynomial through values at the nodes: [places, nodes]"""
    return np.asarray(legendre_values(count, place) @ coefficients(count))
