"""Modes of rectangular thin plates, orthotropic, with ribs."""

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from engine.arithmetic.eigenpairs import Eigenproblem
from engine.arithmetic.elementary import cos, sin, square
from engine.arithmetic.plain_numbers import power
from engine.arithmetic.products import product as multiply
from engine.bodies.body import UnfitBody
from engine.bodies.lowest_modes import Block, estimate_highest, lowest_modes, symmetric, with_signs
from engine.bodies.product_shapes import ProductSum, sum_products
from engine.bodies.side_functions import Edge, SideFunctions

MAX_RITZ_MODES = 400  # of a body whose modes are found so and that does not say how many
MAX_RATE_STEPS = 2_000  # of a search, 5 % each
MAX_FUNCTIONS = 400  # of one side
MAX_WORK = 2.5e10  # third powers of the sizes of all matrices: ten seconds; beyond, they take minutes and gigabytes
DIRECTIONS = 360  # over which the compliance of wood is a mean
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

    def yielding(self) -> float:
        """D of a plate of one modulus whose waves above a frequency yield as much to a point: 1/√D is the mean of
        1/√D(θ) over all directions, D(θ) = Dx·cos⁴θ + 2·(D1 + 2·Dk)·cos²θ·sin²θ + Dy·sin⁴θ."""
        angle = np.linspace(0.0, np.pi, DIRECTIONS, endpoint=False)
        along, across = square(cos(angle)), square(sin(angle))
        rigidity = (
            self.x * square(along) + 2 * (self.coupling + 2 * self.twist) * along * across + self.y * square(across)
        )
        return 1 / square(float(np.add.reduce(1 / np.sqrt(rigidity))) / DIRECTIONS)


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
        return np.asarray(scale * sin(math.pi * m * x) * sin(math.pi * n * y))

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
        x, y = (
            square((number + shift) * math.pi / side) for number, shift, side in zip((m, n), shifts, sides, strict=True)
        )
        bend = (
            stiffness.x * square(x) + 2 * (stiffness.coupling + 2 * stiffness.twist) * x * y + stiffness.y * square(y)
        )
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
        basis = ritz_basis(sheet, few)
        rough = math.sqrt(estimate_highest(basis.blocks, basis.lowest * count * math.sqrt(count), count))
        top = rough if rough < max_omega else top
    while True:
        top = min(top, max_omega)
        numbers = polynomial_counts(sheet, top)
        if (
            top < max_omega
            and math.prod(number + sheet.count_places(axis) for axis, number in enumerate(numbers)) < count
        ):
            top = 1.3 * top
            continue
        modes = ritz_modes(sheet, numbers, count, max_omega)
        if modes.omega.size < count and top < max_omega:  # too few functions, or the others lie above
            top = max_omega
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

    def count_places(self, axis: int) -> int:
        """Places of x (0) or y (1) at which ribs cross it."""
        return len({rib.at for rib in self.ribs_across(axis)})

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
    stiffness, tension, inertia = sheet.stiffness, sheet.tension, sheet.density * square(top)
    narrow = 1 - min(square(stiffness.coupling) / (stiffness.x * stiffness.y), 0.5)  # a strip bends more easily
    counts = []
    for axis, rigidity in enumerate((narrow * stiffness.x, narrow * stiffness.y)):
        beta2 = (math.sqrt(square(tension) + 4 * rigidity * inertia) - tension) / (2 * rigidity)
        rates = [rib_rates(sheet, rib, top)[0 if rib.along == "xy"[axis] else 1] for rib in sheet.ribs]
        degree = max([math.sqrt(beta2), *rates]) * sheet.sides[axis] / 2
        margin = 7 if "free" in sheet.edges[axis] else 5
        counts.append(math.ceil(degree + 1.5 * power(degree, 1 / 3)) + margin)
    return counts


def rib_rates(sheet: Sheet, rib: Rib, omega: float) -> tuple[float, float]:
    """Of a wave that a heavy rib holds: its wave number along the rib, and the rate at which it falls off beside it.

    Both in 1/m, and 0 if the rib is stiff rather than heavy. EI·k⁴ + 2·Dx·γ1·γ2·(γ1 + γ2) = μω²; γ1 and γ2 are the
    roots of Dx·γ⁴ - 2(D1 + 2Dk)·k²γ² + Dy·k⁴ = ρω². This is for a rib along y.
    """
    d, inertia = sheet.stiffness, sheet.density * square(omega)
    along, across = (d.y, d.x) if rib.along == "y" else (d.x, d.y)
    k = free_wave = math.sqrt(math.sqrt(inertia / along))
    for _ in range(MAX_RATE_STEPS):
        mean = (d.coupling + 2 * d.twist) / across * square(k)  # of γ1² and γ2²
        product = math.sqrt(max(along * square(square(k)) - inertia, 0.0) / across)
        plate = 2 * across * product * math.sqrt(2 * (mean + product))
        if rib.bending * square(square(k)) + plate >= rib.density * square(omega):
            break
        k *= 1.05
    if k == free_wave:
        return 0.0, 0.0
    return k, math.sqrt(max(mean + math.sqrt(max(square(mean) - square(product), 0.0)), product))


class RitzBasis(NamedTuple):
    """Products of functions of x and of y, in blocks that do not mix."""

    axes: Sequence[SideFunctions]
    groups: Sequence[tuple[np.ndarray, np.ndarray]]  # of each block, numbers of the functions of x and of y
    blocks: Sequence[Block]
    lowest: float  # about the lowest ω², 1/s²


def ritz_basis(sheet: Sheet, polynomials: Sequence[int]) -> RitzBasis:
    """Products of so many polynomials of x and of y, and of the cubics of the ribs."""
    along, across = (n + sheet.count_places(axis) for axis, n in enumerate(polynomials))
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
    stiffness, loads = energies(sheet, axes)
    rigid = rigid_products(sheet)
    groups = [(x, y) for x in parity_groups(sheet, axes[0], 0) for y in parity_groups(sheet, axes[1], 1)]
    blocks = [
        Block(
            Eigenproblem(
                add_products(stiffness, x, y),
                (x.size, y.size),
                [(axis, load[np.ix_((x, y)[axis], (x, y)[axis])]) for axis, load in loads],
            ),
            [j for j, pair in enumerate(product(x.tolist(), y.tolist())) if pair in rigid],
        )
        for x, y in groups
    ]
    lowest = float(lowest_products(sheet.sides, sheet.stiffness, sheet.density, sheet.tension, 1)[2][0])
    return RitzBasis(axes, groups, blocks, square(lowest))


def ritz_modes(sheet: Sheet, polynomials: Sequence[int], count: int, max_omega: float) -> PlateModes:
    """Modes in products of so many polynomials of x and of y, and of the cubics of the ribs."""
    basis = ritz_basis(sheet, polynomials)
    pairs = lowest_modes(basis.blocks, basis.lowest * count * math.sqrt(count), count, max_omega)
    omega = np.sqrt(np.concatenate([values for values, _ in pairs]))
    order = np.argsort(omega, kind="stable")[:count]
    order = order[omega[order] < max_omega]
    rank = np.full(omega.size, -1)
    rank[order] = np.arange(order.size)
    ranks_of_blocks = np.split(rank, np.cumsum([values.size for values, _ in pairs])[:-1])
    sums = []
    for (x, y), (_, vectors), ranks in zip(basis.groups, pairs, ranks_of_blocks, strict=True):
        kept = ranks >= 0
        sums.append(ProductSum(x, y, with_signs(vectors[:, kept]), ranks[kept]))
    scale = 1 / math.sqrt(sheet.density * sheet.sides[0] * sheet.sides[1])
    return PlateModes(omega[order], sum_products(basis.axes, sums, order.size, scale))


Products = list[tuple[np.ndarray | None, np.ndarray | None]]  # matrices of the functions of x, and of y; None: of ones


def energies(sheet: Sheet, axes: Sequence[SideFunctions]) -> tuple[Products, list[tuple[int, np.ndarray]]]:
    """Stiffness of a plate and its ribs, per mass of the plate alone, as a sum of products, and the mass of the ribs:
    the axis that they cross, and a matrix of its functions."""
    a, b = sheet.sides
    d = PlateStiffness(*(rigidity / sheet.density for rigidity in sheet.stiffness))
    tension, area = sheet.tension / sheet.density, a * b
    x, y = axes[0].integrals, axes[1].integrals
    stiffness: list[tuple[np.ndarray | None, np.ndarray | None]] = [
        (d.x / (square(a * a)) * x[2, 2] + tension / (a * a) * x[1, 1], None),
        (None, d.y / (square(b * b)) * y[2, 2] + tension / (b * b) * y[1, 1]),
        (4 * d.twist / (area * area) * x[1, 1], y[1, 1]),
    ]
    if d.coupling:
        factor = d.coupling / (area * area)
        stiffness += [(factor * x[2, 0], y[0, 2]), (factor * x[0, 2], y[2, 0])]
    loads = []
    for axis in range(2):
        ribs = sheet.ribs_across(axis)
        if not ribs:
            continue
        side, length = sheet.sides[axis], sheet.sides[1 - axis]
        fourth = square(length * length)
        at = axes[axis].values(np.array([rib.at for rib in ribs]))[0]  # [ribs, functions]
        bend = multiply(at.T, at * np.array([[rib.bending / (sheet.density * side * fourth)] for rib in ribs]))
        heavy = multiply(at.T, at * np.array([[rib.density / (sheet.density * side)] for rib in ribs]))
        loads.append((axis, symmetric(heavy)))
        stiffness.append((bend, y[2, 2]) if axis == 0 else (x[2, 2], bend))
    return stiffness, loads


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
    total = np.zeros((x.size, y.size, x.size, y.size))
    for m, n in terms:
        if n is None and m is not None:
            part = m[np.ix_(x, x)]
            for j in range(y.size):
                total[:, j, :, j] += part
        elif m is None and n is not None:
            part = n[np.ix_(y, y)]
            for i in range(x.size):
                total[i, :, i, :] += part
        elif m is not None and n is not None:
            total += m[np.ix_(x, x)][:, None, :, None] * n[np.ix_(y, y)][None, :, None, :]
    return symmetric(total.reshape(x.size * y.size, -1))
