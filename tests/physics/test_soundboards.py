"""Soundboards from their dimensions, and shells of drums, as bodies of a patch."""

import math

import numpy as np
import pytest

import engine
from bench.scenes.small import scene
from engine.bodies import CylindricalShell, Soundboard
from engine.bodies.materials import MATERIALS

PLAIN = {"name": "b", "kind": "soundboard", "size": [1.4, 0.9], "thickness": 9e-3, "modes": 30}
RIBS = {"count": 12, "width": 0.025, "height": 0.022}


def hertz(**more) -> np.ndarray:
    return Soundboard(**PLAIN | more).modal_body(5_000.0).omega / (2 * math.pi)


def test_spruce_is_that_of_the_wood_handbook():
    """E_L 11.9 GPa (a tenth above 10.8 of bending), E_R 0.078 of it, G_LR 0.064, at 12 % moisture 448 kg/m³."""
    spruce = MATERIALS["spruce"]
    assert spruce.young == pytest.approx(11.88e9)
    assert spruce.across == pytest.approx(0.93e9, rel=0.01)
    assert spruce.shear == pytest.approx(0.76e9, rel=0.01)
    assert spruce.density == pytest.approx(448.0)


def test_a_board_without_ribs_is_a_plate_of_wood():
    """Hinged: ρω² = Dx·kx⁴ + 2·(D1 + 2·Dk)·kx²·ky² + Dy·ky⁴."""
    d = Soundboard(**PLAIN).stiffness()
    x, y = (math.pi / 1.4) ** 2, (math.pi / 0.9) ** 2
    wanted = math.sqrt((d.x * x**2 + 2 * (d.coupling + 2 * d.twist) * x * y + d.y * y**2) / (448.0 * 9e-3)) / (
        2 * math.pi
    )
    assert hertz(edges="supported")[0] == pytest.approx(wanted, rel=1e-9)


def test_many_ribs_make_the_board_as_stiff_across_as_along():
    """A dozen ribs close to each other act as a stiffness EI/spacing across the grain (Timoshenko &
    Woinowsky-Krieger, sec. 87), and as mass spread evenly."""
    board = Soundboard(**PLAIN | {"ribs": RIBS, "edges": "supported"})
    rib, spacing = board.beams()[0], 1.4 / 12
    d, heavy = board.stiffness(), board.surface_density() + rib.density / spacing
    x, y = (math.pi / 1.4) ** 2, (math.pi / 0.9) ** 2
    spread = d.x * x**2 + 2 * (d.coupling + 2 * d.twist) * x * y + (d.y + rib.bending / spacing) * y**2
    assert hertz(ribs=RIBS, edges="supported")[0] == pytest.approx(math.sqrt(spread / heavy) / (2 * math.pi), rel=3e-3)
    assert hertz(ribs=RIBS, edges="supported")[0] > 1.3 * hertz(edges="supported")[0]


def test_a_rib_bends_with_the_board_it_is_glued_to():
    """Composite beam: of two equal layers of the same wood glued together, eight times as stiff as one, and each alone
    is one; so the rib adds seven."""
    layer = {"count": 7, "width": 0.2, "height": 9e-3, "wood": "spruce"}
    board = Soundboard(**PLAIN | {"ribs": layer})
    modulus = MATERIALS["spruce"].young
    own = MATERIALS["spruce"].across * 0.18 * 9e-3  # of the strip, a fifth of 0.9 m wide
    stretch = modulus * 0.2 * 9e-3
    wanted = modulus * 0.2 * 9e-3**3 / 12 + 9e-3**2 * stretch * own / (stretch + own)
    assert board.beams()[0].bending == pytest.approx(wanted, rel=1e-12)
    assert board.beam("x", 0.5, board.ribs, 0.2).bending == pytest.approx(7 * modulus * 0.2 * 9e-3**3 / 12, rel=1e-12)


def test_it_loses_two_percent_in_a_radian_unless_it_says_otherwise():
    own = Soundboard(**PLAIN).modal_body(5_000.0)
    np.testing.assert_allclose(2 * own.sigma / own.omega, 0.02)
    own = Soundboard(**PLAIN | {"decay": {"kind": "loss_factor", "eta": 0.01}}).modal_body(5_000.0)
    np.testing.assert_allclose(2 * own.sigma / own.omega, 0.01)


def test_a_struck_shell_rings_at_its_own_frequencies_and_keeps_its_energy():
    """The lowest of a free shell is nearly Rayleigh's n²(n² - 1)²/(n² + 1)·D/(ρhR⁴), n = 2."""
    shell = {"name": "s", "kind": "shell", "radius": 0.178, "length": 0.14, "thickness": 2e-3, "young": 7e10}
    shell |= {"density": 2700.0, "modes": 40}
    stiff = 7e10 * 2e-3**3 / 12 / (1 - 0.09)
    rayleigh = math.sqrt(4 * 9 / 5 * stiff / (2700 * 2e-3 * 0.178**4)) / (2 * math.pi)
    body = CylindricalShell(**shell).modal_body(20_000.0)
    assert body.omega[0] / (2 * math.pi) == pytest.approx(rayleigh, rel=0.02)
    hit = [{"body": "s", "kind": "half_sine", "at": [0.1, 0.4], "amplitude": 100.0, "duration": 2e-4}]
    result = engine.render(scene([shell], pickup=[{"body": "s", "at": [0.3, 0.6]}], force=hit), seconds=0.2)
    assert result.stats.energy.error_max < 1e-13
    spectrum = np.abs(np.fft.rfft(result.audio[:, 0] * np.hanning(result.audio.shape[0])))
    peaks = np.fft.rfftfreq(result.audio.shape[0], 1 / 44_100)[np.argsort(spectrum)[-5:]]
    assert all(np.min(np.abs(body.omega / (2 * math.pi) - f)) < 6 for f in peaks)
