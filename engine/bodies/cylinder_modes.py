"""Modes of thin cylindrical shells, such as that of a drum."""

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from engine.arithmetic import plain_numbers
from engine.arithmetic.eigenpairs import Eigenproblem
from engine.arithmetic.elementary import cos, sin, square
from engine.arithmetic.linear import symmetric_eigenvectors
from engine.arithmetic.products import product
from engine.arithmetic.quadrature import gauss_legendre
from engine.bodies.body import UnfitBody
from engine.bodies.lowest_modes import Block, lowest_modes, symmetric, with_signs
from engine.bodies.plate_modes import MAX_WORK, PlateModes
from engine.bodies.side_functions import Edge, SideFunctions

FIRST_ORDER = 2  # n = 0 and n = 1 are left out: breathing and torsion, and the bending of the whole tube
FIRST_RING = 6 / math.sqrt(5)  # ω·R² of the slowest ring, of two waves around, in √(D/ρh)
ORDER_COST = 150  # functions: what an order takes beside its matrices
SHIFT = 1e-3  # of eigenvalues, times the highest that is wanted: so the lowest are also exact
ROOM = 1.15  # how much the wave number of a mode may be above that of a plane wave of its frequency

ENDS: dict[Edge, tuple[Edge, Edge, Edge]] = {  # what the motions along, around and outward do at the ends
    "free": ("free", "free", "free"),
    "supported": ("free", "supported", "supported"),
    "clamped": ("supported", "supported", "clamped"),
}


class Shell(NamedTuple):
    """A thin cylindrical shell."""

    radius: float  # R of its middle surface, m
    length: float  # L, m
    thickness: float  # h, m
    young: float  # E, Pa
    poisson: float  # ν
    density: float  # ρ of the material, kg/m³

    def stretching(self) -> float:
        """Eh/(1 - ν²), N/m."""
        return self.young * self.thickness / (1 - self.poisson * self.poisson)

    def rigidity(self) -> float:
        """D = Eh³/12(1 - ν²), N·m."""
        return self.stretching() * self.thickness * self.thickness / 12

    def highest_wave_number(self, omega: float) -> float:
        """Of modes up to an angular frequency (rad/s), 1/m: of bending, or of shear in the surface."""
        bending = math.sqrt(omega / math.sqrt(self.rigidity() / (self.density * self.thickness)))
        shear = omega / math.sqrt(self.young / (2 * (1 + self.poisson) * self.density))
        return ROOM * max(bending, shear)


class Waves(NamedTuple):
    """Modes of some orders n, each for one turn of cos nθ, in no order."""

    omega: np.ndarray  # [waves], rad/s
    order: np.ndarray  # [waves], n
    outward: Callable[[np.ndarray], np.ndarray]  # heights [...], fractions of L → [..., waves], 1/√kg


def cylinder_modes(
    shell: Shell, ends: Literal["supported", "clamped", "free"] = "free", count: int = 100, max_omega: float = math.inf
) -> PlateModes:
    """Modes with n ≥ 2 waves around, and their outward motion. A position is [angle, height], of a turn and of L.

    By the strains of Sanders, and the inertia of all three motions (Leissa, Vibration of Shells, sec. 1.3 to 2.1).
    "supported" ends stay round but can move along the axis, and have a closed form; the others are by the
    Rayleigh-Ritz method in polynomials of the height. Each frequency comes twice, with cos nθ and sin nθ. The
    thickness must be small: terms of the size h/R, h/L and (kh)², with the wave number k, are left out.

    count: of modes at most; max_omega: all are below it, rad/s
    """
    plane = 2 * count / (shell.radius * shell.length)  # wave number² below which a flat sheet has so many
    ring = FIRST_RING / (shell.radius * shell.radius)  # below it, there are hardly any
    limit = min(max(plane, ring) * math.sqrt(shell.rigidity() / (shell.density * shell.thickness)), max_omega)
    while True:
        waves = supported_waves(shell, limit) if ends == "supported" else ritz_waves(shell, ends, limit)
        if 2 * waves.omega.size >= count or limit >= max_omega:
            break
        limit = min(1.3 * limit, max_omega)
    rising = np.argsort(waves.omega, kind="stable")
    which = np.repeat(rising, 2)[:count]
    turn = np.tile([0.0, math.pi / 2], rising.size)[:count]
    order = waves.order[which]

    def shape(position: Any) -> np.ndarray:
        angle, height = np.moveaxis(np.asarray(position, float), -1, 0)
        around = cos(2 * math.pi * order * angle[..., None] - turn)
        return np.asarray(waves.outward(height)[..., which] * around)

    return PlateModes(waves.omega[which], shape)


def orders_below(shell: Shell, omega: float) -> np.ndarray:
    """Orders n of which some modes may lie below an angular frequency (rad/s)."""
    return np.arange(float(FIRST_ORDER), math.sqrt(square(shell.radius * shell.highest_wave_number(omega)) + 1) + 1)


def strain_rows(shell: Shell, n: float, u: Any, v: Any, w: Any) -> list[list[Any]]:
    """Strains of the motions u·cos nθ along, v·sin nθ around and w·cos nθ outward, as rows of their factors.

    u, v, w: each the function and its derivatives by the height, /m
    Rows: ε_x, ε_θ, γ, then κ_x, κ_θ and the twist; of γ and the twist times sin nθ, of the others times cos nθ.
    """
    r = shell.radius
    return [
        [u[1], 0 * v[0], 0 * w[0]],
        [0 * u[0], n / r * v[0], w[0] / r],
        [-n / r * u[0], v[1], 0 * w[0]],
        [0 * u[0], 0 * v[0], -w[2]],
        [0 * u[0], n / (r * r) * v[0], n * n / (r * r) * w[0]],
        [n / (2 * r * r) * u[0], 1.5 / r * v[1], 2 * n / r * w[1]],
    ]


def elastic_law(shell: Shell) -> np.ndarray:
    """The matrix of twice the energy per area of the strains [6, 6], N/m, of curvatures N·m."""
    poisson = shell.poisson
    plane = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    law = np.zeros((6, 6))
    law[:3, :3], law[3:, 3:] = shell.stretching() * plane, shell.rigidity() * plane
    return law


def supported_waves(shell: Shell, limit: float) -> Waves:
    """u = A·cos(mπx/L), v = B·sin(mπx/L), w = C·sin(mπx/L), times cos nθ or sin nθ: three modes for each m and n."""
    highest = shell.highest_wave_number(limit) * shell.length / math.pi
    half_waves, orders = np.arange(1.0, highest + 2), orders_below(shell, limit)
    m, n = (grid.ravel() for grid in np.meshgrid(half_waves, orders, indexing="ij"))
    k, one = m * math.pi / shell.length, np.ones(m.size)
    rows = np.array(strain_rows(shell, n, [one, -k], [one, k], [one, k, -k * k]))  # [6, 3, waves]
    strains = np.moveaxis(rows, -1, 0)  # [waves, 6, 3]
    energy = product(np.swapaxes(strains, -1, -2), product(elastic_law(shell), strains))
    square, vectors = symmetric_eigenvectors(energy)
    omega = np.sqrt(np.maximum(square, 0.0) / (shell.density * shell.thickness))  # [waves, 3]
    wave, root = np.nonzero(omega < limit)
    scale = 1 / math.sqrt(math.pi * shell.radius * shell.length / 2 * shell.density * shell.thickness)
    outward = scale * np.abs(vectors[wave, 2, root])
    half_turns = math.pi * m[wave]

    def motion(height: np.ndarray) -> np.ndarray:
        return np.asarray(outward * sin(half_turns * height[..., None]))

    return Waves(omega[wave, root], n[wave], motion)


def check_work(functions: int, orders: int) -> None:
    """Raise UnfitBody if the modes of so many orders, of so many functions of the height, would take minutes."""
    most = ((MAX_WORK / (2 * orders)) ** (1 / 3) - ORDER_COST) / 1.5  # of three motions, even or odd
    if functions > most:
        message = f"needs {functions} functions of its height for each of {orders} orders of its modes"
        limit = f"at most {max(0.0, most):.0f} for so many orders, or they take minutes"
        raise UnfitBody(f"{message}; {limit}: fewer modes, or nearer to a drum")


class RitzEnergy:
    """Twice the energy of sums of functions of the height, for any order n.

    motions: functions of u, of v and of w [derivatives, points, functions], with the weights of a quadrature in them
    """

    def __init__(self, shell: Shell, motions: Sequence[np.ndarray]) -> None:
        self.shell, self.law = shell, elastic_law(shell)
        self.series = [values for motion in motions for values in motion]  # [points, functions] of each derivative
        ends = np.cumsum([0, *(motion.shape[-1] for motion in motions)])
        self.places = [slice(*ends[i : i + 2]) for i, motion in enumerate(motions) for _ in motion]  # in the matrix
        self.size, self.integrals = int(ends[-1]), dict[tuple[int, int], np.ndarray]()

    def matrix(self, n: float) -> np.ndarray:
        """Over cos² or sin² nθ [functions of all motions, the same], N/m³."""
        ones = np.eye(len(self.series)).reshape(3, -1, len(self.series))
        strains = np.array(strain_rows(self.shell, n, *ones)).sum(axis=1)  # [6, series]
        factors = product(strains.T, product(self.law, strains))
        total = np.zeros((self.size, self.size))
        for i, j in zip(*np.nonzero(factors), strict=True):
            if (i, j) not in self.integrals:
                self.integrals[i, j] = product(self.series[i].T, self.series[j])
            total[self.places[i], self.places[j]] += factors[i, j] * self.integrals[i, j]
        return total


def ritz_waves(shell: Shell, ends: Edge, limit: float) -> Waves:
    """Modes of a shell whose ends are alike, by the Rayleigh-Ritz method."""
    half = shell.length / 2
    waves = shell.highest_wave_number(limit) * half
    border = half / math.sqrt(shell.radius * shell.thickness)  # bending falls off from an end in √(Rh)
    number = math.ceil(waves + 1.5 * plain_numbers.power(waves, 1 / 3) + 2 * math.sqrt(border)) + 8
    check_work(number, orders_below(shell, limit).size)
    motions = [SideFunctions((end, end), number, []) for end in ENDS[ends]]
    t, weight = gauss_legendre(number + 6)
    lengths = np.array([1.0, 1 / shell.length, 1 / (shell.length * shell.length)])[:, None, None]
    u, v, w = (np.sqrt(weight / 2)[:, None] * motion.values((1 + t) / 2, 3) * lengths for motion in motions)
    outward = motions[2]
    scale = 1 / math.sqrt(math.pi * shell.radius * shell.length * shell.density * shell.thickness)
    omegas, orders, factors = [np.zeros(0)], [np.zeros(0)], [np.zeros((number, 0))]
    for odd in (0, 1):  # about the middle; u is odd where v and w are even
        chosen = [motions[0].odd != odd, motions[1].odd == odd, motions[2].odd == odd]
        energy = RitzEnergy(shell, [motion[..., keep] for motion, keep in zip((u, v, w), chosen, strict=True)])
        for n in orders_below(shell, limit):
            block = symmetric(energy.matrix(n)) / (shell.density * shell.thickness)
            problem = Eigenproblem(block, block.shape[:1])
            ((square, vectors),) = lowest_modes([Block(problem, [])], SHIFT * limit * limit, block.shape[0], limit)
            below = np.sqrt(square) < limit
            of_block = np.zeros((3 * number, int(np.count_nonzero(below))))
            of_block[np.concatenate(chosen)] = with_signs(vectors[:, below])
            omegas.append(np.sqrt(square[below]))
            orders.append(np.full(of_block.shape[1], n))
            factors.append(scale * of_block[2 * number :])
    shapes = np.concatenate(factors, axis=1)

    def motion(height: np.ndarray) -> np.ndarray:
        return product(outward.values(height)[0], shapes)

    return Waves(np.concatenate(omegas), np.concatenate(orders), motion)
