"""Modes of cylindrical shells: against Rayleigh, published tables, and the elasticity of a thick-walled tube."""

import math

import numpy as np
import pytest
import scipy

from engine.bodies.cylinder_modes import Shell, cylinder_modes, ritz_waves, supported_waves

DRUM = Shell(radius=0.18, length=0.14, thickness=0.006, young=10e9, poisson=0.3, density=650.0)
TUBE = Shell(radius=0.1, length=1.0, thickness=0.001, young=200e9, poisson=0.3, density=7800.0)
SNARE = Shell(radius=0.178, length=0.165, thickness=0.0015, young=70e9, poisson=0.33, density=2700.0)


def rayleigh(shell: Shell, n: int) -> float:
    """Without stretching, of a long shell with free ends: ω² = D·n²(n² - 1)²/(ρh·R⁴(n² + 1))."""
    square = shell.rigidity() * n**2 * (n**2 - 1) ** 2 / (n**2 + 1)
    return math.sqrt(square / (shell.density * shell.thickness * shell.radius**4))


def test_supported_shells():
    """ω·R·√(ρ(1 - ν²)/E) of m = 1 and n = 2, 3, …, L/R = 20, h/R = 0.01, ν = 0.3, as tabulated for Love's theory.

    Loy, Lam & Shu, Analysis of cylindrical shells using generalized differential quadrature, Shock Vib. 4 (1997),
    quoted from memory; the energy method below and three-dimensional elasticity agree.
    """
    wanted = [0.009382, 0.022105, 0.042095, 0.068008, 0.099730, 0.137239, 0.180527, 0.229594, 0.284435]
    waves = supported_waves(Shell(1.0, 20.0, 0.01, 1.0, 0.3, 1.0), 0.6)
    found = [np.min(waves.omega[waves.order == n]) * math.sqrt(1 - 0.3**2) for n in range(2, 11)]
    np.testing.assert_allclose(found, wanted, atol=5e-6)


@pytest.mark.parametrize("shell", [DRUM, TUBE, SNARE], ids=["drum", "tube", "snare"])
def test_supported_shells_by_both_methods(shell):
    """Closed form against polynomials; the latter also have the motions along the axis alone, which do not sound."""
    closed = cylinder_modes(shell, "supported", 80)
    waves = ritz_waves(shell, "supported", 1.0001 * closed.omega[-1])
    heights = np.linspace(0.05, 0.95, 7)
    shapes = waves.outward(heights)
    outward = np.max(np.abs(shapes), axis=0) > 1e-9
    order = np.argsort(waves.omega[outward])
    np.testing.assert_allclose(waves.omega[outward][order][:40], closed.omega[::2], rtol=1e-9)
    at = np.stack([np.zeros(7), heights], axis=-1)
    np.testing.assert_allclose(
        np.abs(shapes[:, outward][:, order][:, :40]), np.abs(closed.shape(at)[:, ::2]), atol=1e-5
    )


@pytest.mark.parametrize("n", [2, 3, 4])
def test_long_free_shells_do_not_stretch(n):
    """Rayleigh's frequency, and of the motion outward n²/(n² + 1) of the kinetic energy: the rest is around."""
    long = Shell(0.1, 3.0, 0.001, 200e9, 0.3, 7800.0)
    waves = ritz_waves(long, "free", 1.2 * rayleigh(long, n))
    own = np.flatnonzero(waves.order == n)
    lowest = own[np.argmin(waves.omega[own])]
    assert waves.omega[lowest] == pytest.approx(rayleigh(long, n), rel=1e-3)
    mass = long.density * long.thickness * math.pi * long.radius * long.length
    t, weight = np.polynomial.legendre.leggauss(60)
    share = mass * np.sum(weight / 2 * waves.outward((1 + t) / 2)[:, lowest] ** 2)
    assert share == pytest.approx(n**2 / (n**2 + 1), rel=1e-3)


def test_short_free_shells_are_rings():
    """Between a ring, which bends across as it likes, and Rayleigh's shell, which cannot."""
    short = Shell(0.2, 0.01, 0.004, 10e9, 0.3, 600.0)
    waves = ritz_waves(short, "free", 1.1 * rayleigh(short, 4))
    for n in (2, 3, 4):
        omega = np.min(waves.omega[waves.order == n])
        assert omega == pytest.approx(rayleigh(short, n) * math.sqrt(1 - 0.3**2), rel=3e-3)
    drum = np.unique(cylinder_modes(DRUM, "free", 2).omega)
    assert math.sqrt(1 - 0.3**2) * rayleigh(DRUM, 2) < drum < rayleigh(DRUM, 2)


def thick_tube(shell: Shell, n: int, along: int = 14, across: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (rad/s) of a tube with free ends by the elasticity of solids, by Rayleigh and Ritz in polynomials.

    Also the motion outward of the middle surface at the heights 0.1 and 0.8 of each mode of unit modal mass.
    """
    t, weight = np.polynomial.legendre.leggauss(along + 6)
    s, weight_s = np.polynomial.legendre.leggauss(across + 6)
    x = np.polynomial.legendre.legvander(t, along - 1)
    dx = np.polynomial.legendre.legval(t, np.polynomial.legendre.legder(np.eye(along))).T * 2 / shell.length
    z = np.polynomial.legendre.legvander(s, across - 1)
    dz = np.polynomial.legendre.legval(s, np.polynomial.legendre.legder(np.eye(across))).T * 2 / shell.thickness
    r = shell.radius + s * shell.thickness / 2
    f, f_x, f_z = np.kron(x, z), np.kron(dx, z), np.kron(x, dz)
    radius = np.tile(r, t.size)[:, None]
    volume = math.pi * np.kron(weight * shell.length / 2, weight_s * r * shell.thickness / 2)
    none = np.zeros_like(f)
    strains = [
        [f_x, none, none],
        [none, n / radius * f, f / radius],
        [none, none, f_z],
        [-n / radius * f, f_x, none],
        [f_z, none, f_x],
        [none, f_z - f / radius, -n / radius * f],
    ]
    rows = np.array([np.concatenate(row, axis=1) for row in strains])
    shear = shell.young / (2 * (1 + shell.poisson))
    bulk = shear * 2 * shell.poisson / (1 - 2 * shell.poisson)
    law = np.diag([2 * shear] * 3 + [shear] * 3)
    law[:3, :3] += bulk
    stiffness = np.einsum("api,ab,p,bpj->ij", rows, law, volume, rows, optimize=True)
    mass = np.kron(np.eye(3), shell.density * f.T @ (volume[:, None] * f))
    square, vectors = scipy.linalg.eigh(stiffness, mass)
    places = np.polynomial.legendre.legvander(2 * np.array([0.1, 0.8]) - 1, along - 1)
    middle = np.kron(places, np.polynomial.legendre.legvander(np.zeros(1), across - 1))
    return np.sqrt(np.maximum(square, 0)), middle @ vectors[2 * f.shape[1] :]


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize(("shell", "count", "rtol"), [(DRUM, 3, 0.02), (SNARE, 5, 0.002)], ids=["drum", "snare"])
def test_free_shells_by_the_elasticity_of_solids(shell, count, rtol, n):
    """The lowest modes of each order; a thin shell leaves out terms of h/L and h/R, 4 and 3 % for the drum."""
    exact, motion = thick_tube(shell, n)
    waves = ritz_waves(shell, "free", 1.1 * exact[count - 1])
    own = np.flatnonzero(waves.order == n)
    own = own[np.argsort(waves.omega[own])][:count]
    np.testing.assert_allclose(waves.omega[own], exact[:count], rtol=rtol)
    shapes = np.abs(waves.outward(np.array([0.1, 0.8]))[:, own])
    np.testing.assert_allclose(shapes, np.abs(motion[:, :count]), atol=2 * rtol * np.max(shapes))


@pytest.mark.hard_for("tube-free", "tube-clamped", "drum-clamped")
@pytest.mark.parametrize("ends", ["free", "clamped", "supported"])
@pytest.mark.parametrize("shell", [DRUM, TUBE], ids=["drum", "tube"])
def test_shells_keep_their_lowest_modes(shell, ends):
    """In pairs, one turned by a quarter wave, as many as are asked for, or all below a frequency."""
    many = cylinder_modes(shell, ends, 120)
    assert many.omega.size == 120
    assert np.all(np.diff(many.omega) >= 0)
    np.testing.assert_array_equal(many.omega[::2], many.omega[1::2])
    few = cylinder_modes(shell, ends, 7)
    np.testing.assert_allclose(few.omega, many.omega[:7], rtol=1e-6)
    limit = (many.omega[59] + many.omega[60]) / 2
    np.testing.assert_allclose(cylinder_modes(shell, ends, 120, limit).omega, many.omega[:60], rtol=1e-6)
    assert cylinder_modes(shell, ends, 50, 1.0).omega.size == 0


@pytest.mark.parametrize("ends", ["free", "clamped", "supported"])
def test_shapes_go_around(ends):
    """cos nθ and sin nθ; pairs are the same turned; ends that are held stay round."""
    modes = cylinder_modes(SNARE, ends, 40)
    angles = np.arange(64) / 64
    around = modes.shape(np.stack([angles, np.full(64, 0.3)], axis=-1))
    spectrum = np.abs(np.fft.rfft(around, axis=0))
    waves = np.argmax(spectrum, axis=0)
    assert np.all(waves >= 2)
    loud = spectrum[waves, np.arange(40)] > 1e-6
    np.testing.assert_allclose(spectrum[:, loud].sum(axis=0), spectrum[waves, np.arange(40)][loud], rtol=1e-9)
    np.testing.assert_allclose(np.sum(around[:, ::2] * around[:, 1::2], axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(np.sum(around[:, ::2] ** 2, axis=0), np.sum(around[:, 1::2] ** 2, axis=0), rtol=1e-9)
    np.testing.assert_allclose(modes.shape([0.25, 0.3]), around[16], atol=1e-12)
    end = np.max(np.abs(modes.shape([[0.1, 0.0], [0.6, 1.0]])))
    assert end > 0.1 if ends == "free" else end < 1e-10
