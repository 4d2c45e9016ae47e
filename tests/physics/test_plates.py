"""Modes of plates: against tables, closed forms, and exact solutions of strips between two supported edges."""

import math

import numpy as np
import pytest
import scipy
from later import import_later

from engine.bodies.circular_plate_modes import circular_plate_modes
from engine.bodies.plate_modes import (
    PlateStiffness,
    Rib,
    Sheet,
    polynomial_counts,
    rectangle_plate_modes,
    ritz_modes,
    supported_plate_modes,
)
from engine.bodies.side_functions import POWERS

mpmath = import_later("mpmath")

SIDES = (1.4, 0.9)
STEEL = PlateStiffness.isotropic(90.0, 0.3)
SPRUCE = PlateStiffness(x=469.0, y=34.0, coupling=12.7, twist=32.0)
NOTHING = Rib("y", 0.37, 0.0, 0.0)  # makes a plate supported all round take the general way

# Leissa, The free vibration of rectangular plates, J. Sound Vib. 31 (1973): ωa²√(ρ/D) of a square, ν = 0.3
SQUARE = {
    "free": [0, 0, 0, 13.468, 19.596, 24.270, 34.801, 34.801, 61.093, 61.093, 63.687, 69.265, 77.172],
    "clamped": [35.985, 73.394, 73.394, 108.22, 131.58, 132.20, 165.00, 165.00],
    ("supported", "supported", "clamped", "clamped"): [28.951, 54.743, 69.327, 94.585, 102.216, 129.096],
    ("supported", "supported", "free", "free"): [9.631, 16.135, 36.726, 38.945, 46.738, 70.740],
    ("clamped", "free", "free", "free"): [3.492, 8.525, 21.429, 27.331, 31.111],  # 3.4711, 8.5065 of more exact work
}


def same_edges(edges) -> list:
    return [edges] * 4 if isinstance(edges, str) else list(edges)


def test_stiffness_of_an_isotropic_plate():
    """D1 + 2·Dk = D: the wave equation is D∇⁴w."""
    assert STEEL.coupling + 2 * STEEL.twist == pytest.approx(STEEL.x, rel=1e-15)


@pytest.mark.parametrize("edges", SQUARE, ids=str)
def test_square_plates(edges):
    wanted = np.array(SQUARE[edges])
    found = rectangle_plate_modes((2.0, 2.0), PlateStiffness.isotropic(3.0, 0.3), 0.5, 0.0, edges, count=wanted.size)
    rtol = 8e-3 if edges[0] == "clamped" and edges[1] == "free" else 1e-4
    np.testing.assert_allclose(found.omega * 4.0 * math.sqrt(0.5 / 3.0), wanted, rtol=rtol)


@pytest.mark.parametrize("edges", ["free", "clamped"])
def test_orthotropic_plates_that_are_square_ones_stretched(edges):
    """With D1 + 2·Dk = √(Dx·Dy), y → y·(Dx/Dy)^¼ makes it isotropic."""
    wanted = np.array(SQUARE[edges])
    stiffness = PlateStiffness(16.0, 1.0, 0.3 * 4.0, 0.35 * 4.0)
    omega = rectangle_plate_modes((1.0, 0.5), stiffness, 16.0, 0.0, edges, count=wanted.size).omega
    np.testing.assert_allclose(omega, wanted, rtol=1e-4)


@pytest.mark.parametrize("tension", [0.0, 3e4])
@pytest.mark.parametrize("stiffness", [STEEL, SPRUCE], ids=["steel", "spruce"])
def test_supported_plates_have_sines(stiffness, tension):
    """ρω² = Dx·kx⁴ + 2(D1 + 2Dk)·kx²·ky² + Dy·ky⁴ + T·(kx² + ky²), from the general way too."""
    m, n = (math.pi * grid / side for grid, side in zip(np.mgrid[1:60, 1:60], SIDES, strict=True))
    cross = 2 * stiffness.coupling + 4 * stiffness.twist
    square = stiffness.x * m**4 + cross * m**2 * n**2 + stiffness.y * n**4 + tension * (m**2 + n**2)
    wanted = np.sqrt(np.sort(square.ravel())[:120] / 3.2)
    closed = supported_plate_modes(SIDES, stiffness, 3.2, tension, 120)
    np.testing.assert_allclose(closed.omega, wanted, rtol=1e-12)
    general = rectangle_plate_modes(SIDES, stiffness, 3.2, tension, "supported", [NOTHING], 120)
    np.testing.assert_allclose(general.omega, wanted, rtol=1e-4)
    np.testing.assert_array_less(wanted * (1 - 1e-9), general.omega)
    place = [0.31, 0.57]
    np.testing.assert_allclose(np.abs(general.shape(place))[:40], np.abs(closed.shape(place))[:40], atol=1e-3)


# --- strips between two supported edges, exactly


def strip_determinant(omega, m, sides, stiffness, density, ends, rib=None) -> float:
    """Zero at the modes sin(mπx/a)·Y(y), from the equation of motion and the conditions at the ends and at a rib.

    Y is a sum of two exponentials and two sines, or hyperbolic sines, on each side of the rib, which is along x.
    """
    a, b = sides
    k = m * math.pi / a
    d = stiffness
    cross = d.coupling + 2 * d.twist
    root = math.sqrt(cross**2 * k**4 - d.y * (d.x * k**4 - density * omega**2))
    fast, slow = (cross * k**2 + root) / d.y, (cross * k**2 - root) / d.y

    def functions(y: float, length: float) -> np.ndarray:
        """Y, Y', Y'', Y''' of four solutions, [derivatives, solutions]."""
        g = math.sqrt(fast)
        columns = [
            [(-g) ** j * math.exp(-g * y) for j in range(4)],
            [g**j * math.exp(g * (y - length)) for j in range(4)],
        ]
        g = math.sqrt(abs(slow))
        c, s = (math.cosh(g * y), math.sinh(g * y) / g) if slow > 0 else (math.cos(g * y), math.sin(g * y) / g)
        columns += [[c, slow * s, slow * c, slow**2 * s], [s, c, slow * s, slow * c]]
        return np.array(columns).T

    def moments(f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bending moment, and shear force with that of the twist."""
        return d.y * f[2] - d.coupling * k**2 * f[0], d.y * f[3] - (d.coupling + 4 * d.twist) * k**2 * f[1]

    def condition(end: str, f: np.ndarray) -> list[np.ndarray]:
        moment, shear = moments(f)
        return {"free": [moment, shear], "supported": [f[0], moment], "clamped": [f[0], f[1]]}[end]

    at = rib.at * b if rib else b / 2
    low, high, none = functions(at, at), functions(0.0, b - at), np.zeros(4)
    force = (rib.bending * k**4 - rib.density * omega**2) * low[0] if rib else none
    rows = [np.concatenate([row, none]) for row in condition(ends[0], functions(0.0, at))]
    rows += [np.concatenate([none, row]) for row in condition(ends[1], functions(b - at, b - at))]
    rows += [np.concatenate([low[j], -high[j]]) for j in range(3)]
    rows += [np.concatenate([moments(low)[1] - force, -moments(high)[1]])]
    matrix = np.array(rows)
    sign, size = np.linalg.slogdet(matrix / np.linalg.norm(matrix, axis=1)[:, None])
    return float(sign * math.exp(size / 8))


@pytest.mark.hard
@pytest.mark.parametrize("stiffness", [STEEL, PlateStiffness(200.0, 30.0, 20.0, 35.0)], ids=["steel", "orthotropic"])
@pytest.mark.parametrize(
    ("ends", "rib"),
    [
        (("free", "free"), None),
        (("clamped", "clamped"), None),
        (("clamped", "free"), Rib("x", 0.3, 400.0, 0.5)),
        (("supported", "supported"), Rib("x", 0.5, 1000.0, 0.4)),
        (("free", "supported"), Rib("x", 0.8, 2.0, 4.0)),  # heavy and limp: it holds waves
    ],
    ids=str,
)
def test_strips_between_supported_edges(stiffness, ends, rib):
    """Each frequency is a zero of the determinant of its strip, and no zero of the first three strips is missed."""
    edges = ("supported", "supported", *ends)
    modes = rectangle_plate_modes(SIDES, stiffness, 3.2, 0.0, edges, [rib] if rib else [], count=50)
    x = (np.arange(128) + 0.5) / 128
    shapes = modes.shape(np.stack([x, np.full(128, 0.437)], axis=-1))
    waves = np.argmax(np.abs(np.sin(math.pi * np.arange(1, 40)[:, None] * x) @ shapes), axis=0) + 1
    for m, omega in zip(waves, modes.omega, strict=True):
        told = (m, SIDES, stiffness, 3.2, ends, rib)
        exact = scipy.optimize.brentq(strip_determinant, omega * (1 - 1e-3), omega * (1 + 1e-5), told, xtol=1e-9)
        assert exact <= omega * (1 + 1e-8)
    for m in (1, 2, 3):
        grid = np.linspace(0.5 * modes.omega[0], 1.0001 * modes.omega[-1], 500)
        signs = np.sign([strip_determinant(w, m, SIDES, stiffness, 3.2, ends, rib) for w in grid])
        assert np.count_nonzero(signs[1:] != signs[:-1]) == np.count_nonzero(waves == m), m


# --- ribs


def test_a_stiff_rib_is_a_support():
    """It divides a plate in two: odd modes have a supported edge there, even ones a clamped one."""
    rib = Rib("y", 0.5, 1e9, 1e-6)
    found = rectangle_plate_modes((1.2, 0.8), STEEL, 3.0, 0.0, "supported", [rib], 30)
    half = (0.6, 0.8)
    odd = supported_plate_modes(half, STEEL, 3.0, count=30).omega
    even = rectangle_plate_modes(
        half, STEEL, 3.0, 0.0, ("supported", "clamped", "supported", "supported"), count=30
    ).omega
    np.testing.assert_allclose(found.omega, np.sort(np.concatenate([odd, even]))[:30], rtol=1e-4)
    y = np.linspace(0, 1, 9)
    there = found.shape(np.stack([np.full(9, 0.5), y], axis=-1))
    assert np.max(np.abs(there)) < 1e-4 * np.max(np.abs(found.shape([0.25, 0.5])))


@pytest.mark.parametrize("edges", ["free", "clamped", "supported"])
def test_close_ribs_are_a_stiffer_plate(edges):
    """At low frequencies, EI and mass per length over the spacing."""
    n = 24
    ribs = [Rib("y", (j + 0.5) / n, 5.0, 0.05) for j in range(n)]
    spacing = 1.4 / n
    found = rectangle_plate_modes(SIDES, STEEL, 3.0, 0.0, edges, ribs, 12).omega
    smeared = STEEL._replace(y=STEEL.y + 5.0 / spacing)
    wanted = rectangle_plate_modes(SIDES, smeared, 3.0 + 0.05 / spacing, 0.0, edges, (), 12).omega
    np.testing.assert_allclose(found, wanted, rtol=0.02)


@pytest.mark.hard
def test_the_order_of_axes_does_not_matter():
    ribs = [Rib("y", 0.3, 400.0, 0.3), Rib("x", 0.6, 100.0, 0.5), Rib("y", 0.8, 50.0, 0.1)]
    turned = [Rib("x" if rib.along == "y" else "y", rib.at, rib.bending, rib.density) for rib in ribs]
    swapped = SPRUCE._replace(x=SPRUCE.y, y=SPRUCE.x)
    edges = ("free", "clamped", "supported", "free")
    one = rectangle_plate_modes(SIDES, SPRUCE, 3.2, 100.0, edges, ribs, 40)
    other = rectangle_plate_modes(SIDES[::-1], swapped, 3.2, 100.0, (*edges[2:], *edges[:2]), turned, 40)
    np.testing.assert_allclose(one.omega, other.omega, rtol=1e-9)
    np.testing.assert_allclose(np.abs(one.shape([0.2, 0.7])), np.abs(other.shape([0.7, 0.2])), atol=1e-7)


def test_mirrored_ribs_give_the_same_as_others():
    """Modes in even and odd blocks, against one block, for which one rib is a little off its place."""

    def board(off: float):
        ribs = [Rib("y", 0.2 + off, 300.0, 0.2), Rib("y", 0.5, 400.0, 0.3), Rib("y", 0.8, 300.0, 0.2)]
        return rectangle_plate_modes(SIDES, SPRUCE, 3.2, 0.0, "clamped", ribs, 50).omega

    np.testing.assert_allclose(board(1e-9), board(0.0), rtol=1e-7)


# --- shapes


CASES = {
    "free": (STEEL, 0.0, "free", []),
    "clamped": (SPRUCE, 1e3, "clamped", []),
    "mixed": (SPRUCE, 0.0, ("free", "clamped", "supported", "free"), []),
    "ribs": (SPRUCE, 0.0, "free", [Rib("y", 0.3, 400.0, 0.5), Rib("y", 0.62, 100.0, 0.3), Rib("x", 0.4, 90.0, 2.0)]),
    "mirrored": (SPRUCE, 0.0, "clamped", [Rib("y", 0.3, 400.0, 0.5), Rib("y", 0.7, 400.0, 0.5)]),
}


@pytest.mark.hard_for("ribs")
@pytest.mark.parametrize("case", CASES)
def test_shapes_are_orthonormal(case):
    """∬ρ·Φ_i·Φ_j dA + Σ∫μ·Φ_i·Φ_j ds = δ_ij; with an edge clamped or supported Φ is 0 there."""
    stiffness, tension, edges, ribs = CASES[case]
    modes = rectangle_plate_modes(SIDES, stiffness, 3.2, tension, edges, ribs, 60)

    def points(axis: int) -> tuple[np.ndarray, np.ndarray]:
        t, w = np.polynomial.legendre.leggauss(50)
        borders = np.unique([0.0, 1.0, *(rib.at for rib in ribs if rib.along == "yx"[axis])])
        width = np.diff(borders)[:, None] / 2
        return (borders[:-1, None] + width * (1 + t)).ravel(), (width * w).ravel() * SIDES[axis]

    (x, wx), (y, wy) = points(0), points(1)
    shapes = modes.shape(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    gram = 3.2 * np.einsum("abi,a,b,abj->ij", shapes, wx, wy, shapes, optimize=True)
    for rib in ribs:
        s, w = (y, wy) if rib.along == "y" else (x, wx)
        line = [np.full(s.size, rib.at), s] if rib.along == "y" else [s, np.full(s.size, rib.at)]
        there = modes.shape(np.stack(line, axis=-1))
        gram += rib.density * there.T @ (there * w[:, None])
    np.testing.assert_allclose(gram, np.eye(60), atol=1e-9)
    for j, edge in enumerate(same_edges(edges)):
        place = [0.37, 0.37]
        place[j // 2] = float(j % 2)
        at_edge = np.max(np.abs(modes.shape(place)))
        assert at_edge < 1e-11 if POWERS[edge] else at_edge > 0.1


def test_a_free_plate_moves_as_a_rigid_body():
    """1/√mass, and tilts about the middle: x·√12/√mass; with a heavy rib the whole mass counts."""
    modes = rectangle_plate_modes(SIDES, STEEL, 3.0, 0.0, "free", count=10)
    np.testing.assert_array_equal(modes.omega[:3], 0.0)
    assert modes.omega[3] > 1.0
    mass = 3.0 * 1.4 * 0.9
    middle, corner = modes.shape([0.5, 0.5])[:3], modes.shape([1.0, 1.0])[:3]
    np.testing.assert_allclose(np.sort(np.abs(middle)) * math.sqrt(mass), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(np.sort(np.abs(corner)) * math.sqrt(mass), [1, math.sqrt(3), math.sqrt(3)], atol=1e-12)
    ribbed = rectangle_plate_modes(SIDES, STEEL, 3.0, 0.0, "free", [Rib("x", 0.1, 10.0, 5.0)], 10)
    np.testing.assert_array_equal(ribbed.omega[:3], 0.0)
    assert np.sum(ribbed.shape([0.5, 0.1])[:3] ** 2) < 1 / mass  # at the rib, it is heavier
    pulled = rectangle_plate_modes(SIDES, STEEL, 3.0, 50.0, "free", count=10).omega
    assert pulled[0] == 0.0 < pulled[1]
    hinged = rectangle_plate_modes(SIDES, STEEL, 3.0, 0.0, ("supported", "free", "free", "free"), count=10).omega
    assert hinged[0] == 0.0 < hinged[1]


# --- how many, and how well


@pytest.mark.hard_for("ribs", "mixed")
@pytest.mark.parametrize("case", CASES)
def test_all_modes_have_converged(case):
    """With many more polynomials none is lower by 0.1 %; by Rayleigh and Ritz none is below the exact one."""
    stiffness, tension, edges, ribs = CASES[case]
    modes = rectangle_plate_modes(SIDES, stiffness, 3.2, tension, edges, ribs, 80)
    (x0, x1, y0, y1) = same_edges(edges)
    sheet = Sheet(SIDES, stiffness, 3.2, tension, ((x0, x1), (y0, y1)), ribs)
    more = [n + 10 for n in polynomial_counts(sheet, modes.omega[-1])]
    better = ritz_modes(sheet, more, 80, math.inf).omega
    np.testing.assert_allclose(modes.omega, better, rtol=1e-3)
    np.testing.assert_array_less(better * (1 - 1e-8) - 1e-9, modes.omega)


@pytest.mark.hard
def test_a_board_with_twelve_ribs_has_converged():
    """A soundboard."""
    ribs = [Rib("y", (j + 1) / 13 + 0.004 * math.sin(j), 950.0, 0.22) for j in range(12)]
    modes = rectangle_plate_modes(SIDES, SPRUCE, 3.2, 0.0, "clamped", ribs, 130)
    assert modes.omega.size == 130
    edges = (("clamped", "clamped"), ("clamped", "clamped"))
    sheet = Sheet(SIDES, SPRUCE, 3.2, 0.0, edges, ribs)
    better = ritz_modes(sheet, [n + 1 for n in polynomial_counts(sheet, modes.omega[-1])], 130, math.inf).omega
    np.testing.assert_allclose(modes.omega, better, rtol=3e-4)


@pytest.mark.hard_for("ribs", "mixed")
@pytest.mark.parametrize("case", CASES)
def test_modes_below_a_frequency_are_the_lowest(case):
    stiffness, tension, edges, ribs = CASES[case]
    all_of_them = rectangle_plate_modes(SIDES, stiffness, 3.2, tension, edges, ribs, 80).omega
    limit = (all_of_them[41] + all_of_them[42]) / 2
    below = rectangle_plate_modes(SIDES, stiffness, 3.2, tension, edges, ribs, 80, limit).omega
    assert below.size == 42
    np.testing.assert_allclose(below, all_of_them[:42], rtol=1e-3)
    few = rectangle_plate_modes(SIDES, stiffness, 3.2, tension, edges, ribs, 4).omega
    np.testing.assert_allclose(few, all_of_them[:4], rtol=1e-3)
    assert rectangle_plate_modes(SIDES, STEEL, 3.2, 0.0, "clamped", count=9, max_omega=1e-3).omega.size == 0


def test_a_large_tension_makes_a_membrane():
    """ρω² → T·k² + D·k⁴, of a membrane that is smaller by the length √(D/T) at each edge."""
    omega = rectangle_plate_modes((0.5, 0.3), PlateStiffness.isotropic(1.0, 0.3), 3.0, 1e5, "clamped", count=20).omega
    m, n = np.mgrid[1:30, 1:30]
    border = 2 * math.sqrt(1.0 / 1e5)
    square = np.sort(((math.pi * m / (0.5 - border)) ** 2 + (math.pi * n / (0.3 - border)) ** 2).ravel())[:20]
    np.testing.assert_allclose(omega, np.sqrt((1e5 * square + square**2) / 3.0), rtol=5e-3)


def test_narrow_plates_are_bars():
    """A free strip without Poisson's effect has the partials of a free bar, 22.373, 61.673, 120.90."""
    stiffness = PlateStiffness.isotropic(2.0, 0.0)
    omega = rectangle_plate_modes((1.0, 0.004), stiffness, 0.5, 0.0, "free", count=6).omega
    np.testing.assert_allclose(omega[3:] / 2.0, [22.3733, 61.6728, 120.9034], rtol=1e-4)


@pytest.mark.hard
def test_shapes_are_the_same_each_time_and_for_many_places():
    first, second = (rectangle_plate_modes(SIDES, SPRUCE, 3.2, 0.0, "free", CASES["ribs"][3], 40) for _ in range(2))
    places = np.random.default_rng(0).random((5, 3, 2))
    many = first.shape(places)
    assert many.shape == (5, 3, 40)
    np.testing.assert_array_equal(many, second.shape(places))
    for index in np.ndindex(5, 3):
        np.testing.assert_allclose(first.shape(places[index].tolist()), many[index], atol=1e-11)


# --- circles

# ωa²√(ρ/D). Leissa, Vibration of Plates, tables 2.1, 2.2 and 2.5, rounds those of the supported plate (4.977, 13.94,
# 25.65, 29.76) and of the free one (5.253, 9.084, 12.23, 20.52) up to 1 % off; these follow from his equations. Those
# of the free plate are those of Itao & Crandall, J. Appl. Mech. 46 (1979).
ROUND = {
    "clamped": (0.3, [10.2158, 21.2604, 21.2604, 34.8770, 34.8770, 39.7711, 51.0300, 51.0300]),
    "supported": (0.3, [4.9351, 13.8982, 13.8982, 25.6133, 25.6133, 29.7200]),
    "free": (0.33, [0, 0, 0, 5.262, 5.262, 9.069, 12.244, 12.244, 20.513, 20.513, 21.527, 21.527, 33.062, 33.062]),
}


@pytest.mark.parametrize("edge", ROUND)
def test_round_plates(edge):
    poisson, wanted = ROUND[edge]
    omega = circular_plate_modes(0.3, 5.0, poisson, 2.0, 0.0, edge, len(wanted)).omega
    np.testing.assert_allclose(omega * 0.09 * math.sqrt(2.0 / 5.0), wanted, atol=6e-4)


def radial_frequencies(m: int, edge: str, poisson: float, pull: float, terms: int = 16) -> np.ndarray:
    """ωa²√(ρ/D) by Rayleigh and Ritz in r^m·(1 - r²)^p·Jacobi polynomials of r², in polar coordinates."""
    r, weight = np.polynomial.legendre.leggauss(80)
    r, weight = (1 + r) / 2, weight / 2
    line = np.polynomial.Polynomial
    rim = line([0.0] * m + [1.0]) * line([1.0, 0.0, -1.0]) ** POWERS[edge]
    inner, low = line([-1.0, 0.0, 2.0]), 2 * POWERS[edge]

    def jacobi(j: int, a: int, b: int, d: int, x: np.ndarray) -> np.ndarray:
        return scipy.special.eval_jacobi(j - d, a + d, b + d, x) if j >= d else np.zeros_like(x)

    rows = []
    for j in range(terms):
        p, p1, p2 = (scipy.special.poch(j + low + m + 1, d) / 2**d * jacobi(j, low, m, d, inner(r)) for d in range(3))
        q = (p, p1 * 4 * r, p2 * 16 * r**2 + p1 * 4)
        w = rim(r), rim.deriv()(r), rim.deriv(2)(r)
        rows.append((w[0] * q[0], w[1] * q[0] + w[0] * q[1], w[2] * q[0] + 2 * w[1] * q[1] + w[0] * q[2]))
    f, f1, f2 = np.array(rows).transpose(1, 0, 2)
    f, f1, f2 = np.array([f, f1, f2]) / np.sqrt((f**2) @ (weight * r))[:, None]
    around, twist = f1 / r - m**2 * f / r**2, m * (f1 / r - f / r**2)

    def integral(g, h):
        return (g * weight * r) @ h.T

    stiff = integral(f2 + around, f2 + around)
    stiff -= (1 - poisson) * (integral(f2, around) + integral(around, f2) - 2 * integral(twist, twist))
    stiff += pull * (integral(f1, f1) + m**2 * integral(f / r, f / r))
    return np.sqrt(np.maximum(scipy.linalg.eigh(stiff, integral(f, f), eigvals_only=True), 0.0))


@pytest.mark.hard
@pytest.mark.parametrize(
    ("edge", "poisson", "pull"),
    [("free", 0.3, 0.0), ("free", 0.0, 0.0), ("supported", 0.3, 0.0), ("supported", 0.2, 70.0), ("clamped", 0.3, 70.0)],
)
def test_round_plates_by_energy(edge, poisson, pull):
    """Another method, for m up to 12; no root is missed and none is too many."""
    omega = circular_plate_modes(1.0, 1.0, poisson, 1.0, pull, edge, 400).omega
    top = 400.0
    wanted = []
    for m in range(30):
        found = radial_frequencies(m, edge, poisson, pull)
        if edge == "free" and m < 2:
            assert found[0] < 1e-3
            found[0] = 0.0
        wanted += [w for w in found[:10] for _ in range(1 if m == 0 else 2) if w < top]
    wanted = np.sort(wanted)
    np.testing.assert_allclose(omega[omega < top], wanted, rtol=1e-6)


@pytest.mark.parametrize("edge", ["clamped", "supported"])
def test_roots_of_round_plates(edge):
    """J_m·I_{m+1} + I_m·J_{m+1} = 0; J_{m+1}/J_m + I_{m+1}/I_m = 2λ/(1 - ν); to the last digits."""
    lowest = np.unique(np.round(np.sqrt(circular_plate_modes(1.0, 1.0, 0.3, 1.0, 0.0, edge, 40).omega), 11))

    def equation(m):
        def value(z):
            j, j1, i, i1 = (
                mpmath.besselj(m, z),
                mpmath.besselj(m + 1, z),
                mpmath.besseli(m, z),
                mpmath.besseli(m + 1, z),
            )
            return j1 * i + i1 * j - (2 * z / 0.7 * j * i if edge == "supported" else 0)

        return value

    for m, index in ((0, 0), (1, 1), (2, 2), (0, 3)):
        near = mpmath.findroot(equation(m), lowest[index])
        assert lowest[index] == pytest.approx(float(near), rel=1e-11)


@pytest.mark.hard
@pytest.mark.parametrize(
    ("edge", "tension", "rigidity"),
    [("free", 0.0, 2.0), ("clamped", 0.0, 2.0), ("supported", 50.0, 2.0), ("clamped", 50.0, 1e-4)],
)
def test_shapes_of_round_plates_are_orthonormal(edge, tension, rigidity):
    modes = circular_plate_modes(0.4, rigidity, 0.3, 3.0, tension, edge, 60)
    r, w = np.polynomial.legendre.leggauss(120)
    r, w = (1 + r[:, None]) / 2, w / 2
    turns = np.arange(40) * 2 * math.pi / 40
    shapes = modes.shape(np.stack([(1 + r * np.cos(turns)) / 2, (1 + r * np.sin(turns)) / 2], axis=-1))
    mass = 3.0 * 0.4**2 * w * r[:, 0] * 2 * math.pi / 40
    np.testing.assert_allclose(np.einsum("abi,a,abj->ij", shapes, mass, shapes, optimize=True), np.eye(60), atol=1e-9)
    np.testing.assert_allclose(modes.shape([0.3, 0.8]), modes.shape(np.array([[0.3, 0.8]]))[0])
    if edge == "free":
        weight = math.pi * 0.4**2 * 3.0
        np.testing.assert_allclose(modes.shape([1.0, 0.5])[:3] * math.sqrt(weight), [1, 2, 0], atol=1e-12)


@pytest.mark.hard
def test_a_limp_round_plate_is_a_membrane():
    """ω → j_mn·√(T/ρ)/(R - √(D/T))."""
    each = [scipy.special.jn_zeros(m, 20) for m in range(40) for _ in range(1 if m == 0 else 2)]
    zeros = np.sort(np.concatenate(each))[:60]
    for rigidity, rtol in ((1e-6, 2e-4), (1e-12, 1e-9)):
        omega = circular_plate_modes(0.5, rigidity, 0.3, 2.0, 8.0, "clamped", 60).omega
        np.testing.assert_allclose(omega, zeros * math.sqrt(8.0 / 2.0) / (0.5 - math.sqrt(rigidity / 8.0)), rtol=rtol)


@pytest.mark.hard
@pytest.mark.parametrize("edge", ROUND)
def test_round_plates_keep_their_lowest_modes(edge):
    """Those below a frequency, and thousands: Weyl's law z²/4 with z = R(ρω²/D)^¼, and a share of the rim's length."""
    many = circular_plate_modes(1.0, 1.0, 0.3, 1.0, 0.0, edge, 1000).omega
    assert many.size == 1000
    z = np.sqrt(many)
    rim = {"clamped": -1.0, "supported": -0.5, "free": 0.65}[edge]
    assert np.max(np.abs(np.arange(1, 1001) - z**2 / 4 - rim * z)) < 60
    for count in (1, 2, 6, 50):
        few = circular_plate_modes(1.0, 1.0, 0.3, 1.0, 0.0, edge, count).omega
        np.testing.assert_array_equal(few, many[:count])
    limit = (many[60] + many[61]) / 2 if many[60] < many[61] else (many[61] + many[62]) / 2
    below = circular_plate_modes(1.0, 1.0, 0.3, 1.0, 0.0, edge, 1000, limit).omega
    np.testing.assert_array_equal(below, many[many < limit])
