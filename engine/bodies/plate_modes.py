"""Modes of rectangular thin plates, orthotropic, with ribs."""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from engine.bodies.body import UnfitBody
from engine.bodies.side_functions import Edge, SideFunctions

MAX_RITZ_MODES = 400  # of a body whose modes are found so and that does not say how many
MAX_RATE_STEPS = 2_000  # of a search, 5 % each
MAX_FUNCTIONS = 400  # of one side
MAX_WORK = 2.5e10  # third powers of the sizes of all matrices: ten seconds; beyond, they take minutes and gigabytes
PLACES_KEPT, MAX_NUMBERS_KEPT = 128, 100_000  # of shapes that were computed: a live change needs the same again
ROUNDING = 1e-9  # relative, of an eigenvalue
ROOM_ABOVE = 1.02  # the highest mode may be so much above the frequency for which the functions were chosen


class PlateStiffness(NamedTuple):
    """Flexural rigidities of an orthotropic plate, N·m.

    Its energy is ½∬ Dx·w_xx² + 2·D1·w_xx·w_yy + Dy·w_yy² + 4·Dk·w_xy² dA (Timoshenko & Woinowsky-Krieger, sec. 85).
    """

    x: float  # Dx
    y: float  # Dy
    coupling: float  # D1
    twist: float  # Dk

    @classmethod
    def isotropic(cls, rigidity: float, poisson: float) -> Self:
        return cls(rigidity, rigidity, poisson * rigidity, (1 - poisson) / 2 * rigidity)

    def mean(self) -> float:
        """√(Dx·Dy)."""
        return math.sqrt(self.x * self.y)


class Rib(NamedTuple):
    """A beam along a whole plate that bends with it and does not resist twist."""

    along: Literal["x", "y"]
    at: float  # fraction of the other side
    bending: float  # EI, N·m²
    density: float  # mass per length, kg/m


class PlateModes(NamedTuple):
    """Modes of a plate without losses, the lowest first."""

    omega: np.ndarray  # [modes], rad/s
    shape: Callable[[Any], np.ndarray]  # positions [..., 2], fractions of the sides → [..., modes], 1/√kg


def supported_plate_modes(
    sides: Sequence[float],
    stiffness: PlateStiffness,
    density: float,
    tension: float = 0.0,
    count: int = 100,
    max_omega: float = math.inf,
) -> PlateModes:
    """Modes of a plate simply supported at its edges, without ribs.

    ρω² = Dx·kx⁴ + 2(D1 + 2Dk)·kx²·ky² + Dy·ky⁴ + T·(kx² + ky²), kx = mπ/a, ky = nπ/b; shapes sin·sin.

    sides: a, b, m; density: ρ, kg/m²; tension: T, N/m
    count: of modes at most; max_omega: all are below it, rad/s
    """
    a, b = sides
    m, n, omega = lowest_products(sides, stiffness, density, tension, count)
    keep = omega < max_omega
    m, n, omega = m[keep], n[keep], omega[keep]
    scale = 2 / math.sqrt(density * a * b)

    def shape(position: Any) -> np.ndarray:
        x, y = np.moveaxis(np.asarray(position, float), -1, 0)[..., None]
        return np.asarray(scale * np.sin(math.pi * m * x) * np.sin(math.pi * n * y))

    return PlateModes(omega, shape)


def lowest_products(
    sides: Sequence[float],
    stiffness: PlateStiffness,
    density: float,
    tension: float,
    count: int,
    shifts: tuple[float, float] = (0.0, 0.0),
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half-waves m and n in x and y, and ω (rad/s), of the `count` lowest waves with kx = (m + shift)π/a.

    m and n start from 1; shifts: of x and y
    """

    def frequency(m: np.ndarray, n: np.ndarray) -> np.ndarray:
        x, y = ((m + shifts[0]) * math.pi / sides[0]) ** 2, ((n + shifts[1]) * math.pi / sides[1]) ** 2
        bend = stiffness.x * x**2 + 2 * (stiffness.coupling + 2 * stiffness.twist) * x * y + stiffness.y * y**2
        return np.asarray(np.sqrt((bend + tension * (x + y)) / density))

    numbers = np.arange(1.0, count + 1)
    one = np.ones(1)
    # of the lowest `count`, the grid of m <= M and n <= N that holds as many bounds the highest frequency
    high = min(
        float(frequency(np.array([float(m)]), np.array([float(math.ceil(count / m))]))[0]) for m in range(1, count + 1)
    )
    m, n = numbers[frequency(numbers, one) <= high], numbers[frequency(one, numbers) <= high]
    m, n = (grid.ravel() for grid in np.meshgrid(m, n, indexing="ij"))
    omega = frequency(m, n)
    if not np.all(np.isfinite(omega)) or omega.size == 0:
        raise ValueError("numbers beyond floating point")
    order = np.argsort(omega, kind="stable")[:count]
    return m[order], n[order], omega[order]


def rectangle_plate_modes(
    sides: Sequence[float],
    stiffness: PlateStiffness,
    density: float,
    tension: float = 0.0,
    edges: Edge | Sequence[Edge] = "supported",
    ribs: Sequence[Rib] = (),
    count: int = 100,
    max_omega: float = math.inf,
) -> PlateModes:
    """Modes of a thin rectangular plate, by the Rayleigh-Ritz method in products of functions of x and of y.

    Those of each side are polynomials, and a cubic with a step of its third derivative at each rib across it. Their
    number follows from the shortest wave. The motions of a plate as a rigid body come first, with ω = 0.

    sides: a, b, m; density: ρ, kg/m²; tension: T, N/m
    edges: one for all, or those at x = 0, x = a, y = 0, y = b
    count: of modes at most; max_omega: all are below it, rad/s
    """
    x0, x1, y0, y1 = [edges] * 4 if isinstance(edges, str) else edges
    if not ribs and {x0, x1, y0, y1} == {"supported"}:
        return supported_plate_modes(sides, stiffness, density, tension, count, max_omega)
    sheet = Sheet(sides, stiffness, density, tension, ((x0, x1), (y0, y1)), ribs)
    top = min(expected_top(sheet, count), max_omega)
    few = [math.ceil(0.7 * n) for n in polynomial_counts(sheet, top)]
    if ribs and count < math.prod(few):  # a rough calculation tells how much higher they make it
        rough = ritz_modes(sheet, few, count, max_omega)
        top = float(rough.omega[-1]) if rough.omega.size == count else top
    while True:
        top = min(top, max_omega)
        numbers = polynomial_counts(sheet, top)
        modes = ritz_modes(sheet, numbers, count, max_omega)
        if modes.omega.size < count and top < max_omega:  # too few functions, or the others lie above
            top = 1.3 * top if math.prod(numbers) < count else max_omega
        elif modes.omega.size == count and modes.omega[-1] > ROOM_ABOVE * top:
            top = float(modes.omega[-1])  # not below the exact one
        else:
            return modes


class Sheet(NamedTuple):
    """A rectangular plate with ribs."""

    sides: Sequence[float]  # m
    stiffness: PlateStiffness
    density: float  # kg/m²
    tension: float  # N/m
    edges: tuple[tuple[Edge, Edge], tuple[Edge, Edge]]  # at the ends of x, of y
    ribs: Sequence[Rib]

    def ribs_across(self, axis: int) -> list[Rib]:
        """Ribs that cross the side x (0) or y (1)."""
        return [rib for rib in self.ribs if rib.along == "yx"[axis]]

    def is_symmetrical(self, axis: int) -> bool:
        """True if the plate is the same from both ends of x (0) or y (1)."""
        return self.edges[axis][0] == self.edges[axis][1] and are_mirrored(self.ribs_across(axis))


def expected_top(sheet: Sheet, count: int) -> float:
    """About the angular frequency (rad/s) of mode number `count`, which stiff ribs make higher.

    As in a bar, a free end takes half a half-wave away, and a clamped one adds a quarter.
    """
    shift = {"free": -0.5, "supported": 0.0, "clamped": 0.25}
    (x0, x1), (y0, y1) = sheet.edges
    shifts = (shift[x0] + shift[x1], shift[y0] + shift[y1])
    density = sheet.density + sum(
        rib.density / sheet.sides[axis] for axis in range(2) for rib in sheet.ribs_across(axis)
    )
    return float(lowest_products(sheet.sides, sheet.stiffness, density, sheet.tension, count, shifts)[2][-1])


def polynomial_counts(sheet: Sheet, top: float) -> list[int]:
    """Count the polynomials of x and of y that are needed for all waves below an angular frequency (rad/s).

    A wave of wave number k on a length L has Legendre coefficients up to degree kL/2; beyond, they fall off within a
    few times (kL/2)^⅓.
    """
    stiffness, tension, inertia = sheet.stiffness, sheet.tension, sheet.density * top**2
    narrow = 1 - min(stiffness.coupling**2 / (stiffness.x * stiffness.y), 0.5)  # a strip bends more easily
    counts = []
    for axis, rigidity in enumerate((narrow * stiffness.x, narrow * stiffness.y)):
        square = (math.sqrt(tension**2 + 4 * rigidity * inertia) - tension) / (2 * rigidity)
        rates = [rib_rates(sheet, rib, top)[0 if rib.along == "xy"[axis] else 1] for rib in sheet.ribs]
        degree = max([math.sqrt(square), *rates]) * sheet.sides[axis] / 2
        margin = 7 if "free" in sheet.edges[axis] else 5
        counts.append(math.ceil(degree + 1.5 * degree ** (1 / 3)) + margin)
    return counts


def rib_rates(sheet: Sheet, rib: Rib, omega: float) -> tuple[float, float]:
    """Of a wave that a heavy rib holds: its wave number along the rib, and the rate at which it falls off beside it.

    Both in 1/m, and 0 if the rib is stiff rather than heavy. EI·k⁴ + 2·Dx·γ1·γ2·(γ1 + γ2) = μω²; γ1 and γ2 are the
    roots of Dx·γ⁴ - 2(D1 + 2Dk)·k²γ² + Dy·k⁴ = ρω². This is for a rib along y.
    """
    d, inertia = sheet.stiffness, sheet.density * omega**2
    along, across = (d.y, d.x) if rib.along == "y" else (d.x, d.y)
    k = free_wave = (inertia / along) ** 0.25
    for _ in range(MAX_RATE_STEPS):
        mean = (d.coupling + 2 * d.twist) / across * k**2  # of γ1² and γ2²
        product = math.sqrt(max(along * k**4 - inertia, 0.0) / across)
        if rib.bending * k**4 + 2 * across * product * math.sqrt(2 * (mean + product)) >= rib.density * omega**2:
            break
        k *= 1.05
    if k == free_wave:
        return 0.0, 0.0
    return k, math.sqrt(max(mean + math.sqrt(max(mean**2 - product**2, 0.0)), product))


def ritz_modes(sheet: Sheet, polynomials: Sequence[int], count: int, max_omega: float) -> PlateModes:
    """Modes in products of so many polynomials of x and of y, and of the cubics of the ribs."""
    ribs = [len({rib.at for rib in sheet.ribs_across(axis)}) for axis in range(2)]
    along, across = (n + more for n, more in zip(polynomials, ribs, strict=True))
    symmetries = math.prod(2 if sheet.is_symmetrical(axis) else 1 for axis in range(2))
    most = symmetries * (MAX_WORK / symmetries) ** (1 / 3)
    if along * across > most or max(along, across) > MAX_FUNCTIONS:
        message = f"needs {along} by {across} functions for its modes"
        limit = f"at most {MAX_FUNCTIONS} of a side and {most:.0f} in all, or they take minutes"
        raise UnfitBody(f"{message}; {limit}: fewer modes or ribs, or nearer to a board")
    axes = [
        SideFunctions(sheet.edges[axis], polynomials[axis], [rib.at for rib in sheet.ribs_across(axis)])
        for axis in range(2)
    ]
    stiffness, mass = energies(sheet, axes)
    rigid = rigid_products(sheet)
    shift = float(lowest_products(sheet.sides, sheet.stiffness, sheet.density, sheet.tension, 1)[2][0]) ** 2
    blocks = []
    for x, y in product(*(parity_groups(sheet, axes[axis], axis) for axis in range(2))):
        first = [j for j, pair in enumerate(product(x.tolist(), y.tolist())) if pair in rigid]
        matrices = add_products(stiffness, x, y), add_products(mass, x, y)
        square, vectors = lowest_vectors(*matrices, shift, first, count, max_omega)
        blocks.append((square, x, y, vectors))
    omega = np.sqrt(np.concatenate([square for square, *_ in blocks]))
    order = np.argsort(omega, kind="stable")[:count]
    order = order[omega[order] < max_omega]
    rank = np.full(omega.size, -1)
    rank[order] = np.arange(order.size)
    sums = []  # of each block: the functions of x and y that it takes, factors [functions, modes], numbers of the modes
    for (_, x, y, vectors), ranks in zip(blocks, np.split(rank, np.cumsum([b[0].size for b in blocks])), strict=False):
        kept = ranks >= 0
        sums.append((x, y, with_signs(vectors[:, kept]), ranks[kept]))
    scale = 1 / math.sqrt(sheet.density * sheet.sides[0] * sheet.sides[1])

    @lru_cache(PLACES_KEPT)
    def shape_at(coordinates: bytes, size: tuple[int, ...]) -> np.ndarray:
        at = np.frombuffer(coordinates).reshape(size)
        along, across = scale * axes[0].values(at[..., 0])[0], axes[1].values(at[..., 1])[0]
        out = np.empty((*at.shape[:-1], order.size))
        for x, y, factors, ranks in sums:
            products = along[..., x, None] * across[..., None, y]
            out[..., ranks] = products.reshape(*at.shape[:-1], -1) @ factors
        out.flags.writeable = False
        return out

    def shape(position: Any) -> np.ndarray:
        at = np.asarray(position, float)
        find = shape_at if at.size * order.size <= MAX_NUMBERS_KEPT else shape_at.__wrapped__
        return find(at.tobytes(), at.shape)

    return PlateModes(omega[order], shape)


Products = list[tuple[np.ndarray, np.ndarray]]  # a matrix of the functions of x, and one of the functions of y


def energies(sheet: Sheet, axes: Sequence[SideFunctions]) -> tuple[Products, Products]:
    """Stiffness and mass of a plate and its ribs, per mass of the plate without them, as sums of products."""
    a, b = sheet.sides
    d, tension, area = sheet.stiffness, sheet.tension, a * b
    x, y = axes[0].integrals, axes[1].integrals
    one_x, one_y = np.eye(x.shape[-1]), np.eye(y.shape[-1])
    stiffness = [
        (d.x / a**4 * x[2, 2] + tension / a**2 * x[1, 1], one_y),
        (one_x, d.y / b**4 * y[2, 2] + tension / b**2 * y[1, 1]),
        (4 * d.twist / area**2 * x[1, 1], y[1, 1]),
    ]
    if d.coupling:
        stiffness += [(d.coupling / area**2 * x[2, 0], y[0, 2]), (d.coupling / area**2 * x[0, 2], y[2, 0])]
    mass = [(one_x, one_y)]
    for axis in range(2):
        ribs = sheet.ribs_across(axis)
        if not ribs:
            continue
        side, length = sheet.sides[axis], sheet.sides[1 - axis]
        at = axes[axis].values(np.array([rib.at for rib in ribs]))[0]  # [ribs, functions]
        bend = at.T @ (at * np.array([[rib.bending / (side * length**4)] for rib in ribs]))
        heavy = at.T @ (at * np.array([[rib.density / (sheet.density * side)] for rib in ribs]))
        stiffness.append((bend, y[2, 2]) if axis == 0 else (x[2, 2], bend))
        mass.append((heavy, one_y) if axis == 0 else (one_x, heavy))
    return [(m / sheet.density, n) for m, n in stiffness], mass


def rigid_products(sheet: Sheet) -> list[tuple[int, int]]:
    """List the products of functions that move a plate without energy: 1, x and y, or the distance from a single
    hinge."""
    edges = [edge for pair in sheet.edges for edge in pair]
    if edges.count("free") == 4:
        return [(0, 0)] if sheet.tension else [(0, 0), (1, 0), (0, 1)]
    is_hinged = edges.count("free") == 3 and "supported" in edges and not sheet.tension
    return [(0, 0)] if is_hinged else []


def parity_groups(sheet: Sheet, functions: SideFunctions, axis: int) -> list[np.ndarray]:
    """The functions of a side that are even about its middle, and those that are odd, where these do not mix."""
    all_of_them = np.arange(functions.odd.size)
    if not functions.has_parity or not sheet.is_symmetrical(axis):
        return [all_of_them]
    return [all_of_them[functions.odd == sign] for sign in (0, 1)]


def are_mirrored(ribs: Sequence[Rib]) -> bool:
    """True if ribs are symmetrical about the middle."""
    here = sorted((rib.at, rib.bending, rib.density) for rib in ribs)
    there = sorted((1 - rib.at, rib.bending, rib.density) for rib in ribs)
    return bool(np.allclose(here, there, rtol=1e-12, atol=1e-12))


def add_products(terms: Products, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A matrix over the products of some functions of x and y."""
    return np.asarray(sum(np.kron(m[np.ix_(x, x)], n[np.ix_(y, y)]) for m, n in terms))


def lowest_vectors(
    stiffness: np.ndarray,
    mass: np.ndarray,
    shift: float,
    rigid: Sequence[int],
    count: int,
    max_omega: float = math.inf,
) -> tuple[np.ndarray, np.ndarray]:
    """Squares of the lowest angular frequencies, and vectors [functions, modes] of modal mass 1.

    Largest eigenvalues 1/(ω² + shift) of M against K + shift·M: so rounding is small against the low modes, though
    the highest functions are stiffer by many orders.

    rigid: functions that span the motions of ω = 0
    count: of vectors at most; if there are no more in all, only those up to max_omega (rad/s) are found
    """
    from scipy.linalg import cholesky, eigh, solve_triangular
    from scipy.linalg.lapack import dsygst

    size = stiffness.shape[0]
    root = cholesky(stiffness + shift * mass)
    reduced, _ = dsygst(mass, root)
    subset: dict[str, Any] = {"subset_by_index": (max(size - count, 0), size - 1)}
    if count >= size and max_omega < math.inf:
        subset = {"subset_by_value": ((1 - ROUNDING) / (max_omega**2 + shift), math.inf)}
    value, vectors = eigh(reduced, lower=False, **subset)
    value, vectors = value[::-1], solve_triangular(root, vectors[:, ::-1] / np.sqrt(value[::-1]))
    square = np.maximum(1 / value - shift, 0.0)
    basis = np.zeros((size, 0))
    for j in rigid[:count]:
        vector = np.eye(size)[:, j]
        vector -= basis @ (basis.T @ (mass @ vector))
        basis = np.column_stack([basis, vector / math.sqrt(vector @ mass @ vector)])
    vectors[:, : basis.shape[1]] = basis
    square[: basis.shape[1]] = 0.0
    return square, vectors


def with_signs(vectors: np.ndarray) -> np.ndarray:
    """Vectors whose first component of at least half the largest is positive."""
    if not vectors.size:
        return vectors
    large = np.argmax(np.abs(vectors) >= 0.5 * np.max(np.abs(vectors), axis=0), axis=0)
    return np.asarray(vectors * np.sign(vectors[large, np.arange(vectors.shape[1])]))
