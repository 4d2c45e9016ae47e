"""Plates of a patch: how they are held, of what, and how they move as a whole."""

import math

import numpy as np
import pytest

import engine
from bench.scenes.small import scene
from engine.bodies import Membrane, Plate

STEEL = {"young": 2.0e11, "poisson": 0.3, "thickness": 1e-3, "area_density": 7.85}
D = 2.0e11 * 1e-9 / (12 * (1 - 0.09))  # N·m


def plate(**more) -> Plate:
    return Plate(**{"name": "p", "kind": "plate"} | more)


def hertz(body) -> np.ndarray:
    return body.modal_body(5_000.0).omega / (2 * math.pi)


@pytest.mark.hard_for("free-13.468")
@pytest.mark.parametrize(("edges", "number"), [("supported", 2 * math.pi**2), ("clamped", 35.985), ("free", 13.468)])
def test_the_first_mode_of_a_square(edges, number):
    """ω·a²·√(ρ/D): Leissa, Vibration of Plates, tables 4.1, 4.22 and 4.76, to the digits of today's calculations."""
    f = hertz(plate(size=[0.4, 0.4], edges=edges, **STEEL))
    assert f[0] == pytest.approx(number / (2 * math.pi * 0.16) * math.sqrt(D / 7.85), rel=3e-5)


@pytest.mark.hard_for("clamped-10.2158")
@pytest.mark.parametrize(("edges", "number"), [("supported", 4.935), ("clamped", 10.2158), ("free", 5.358)])
def test_the_first_mode_of_a_circle(edges, number):
    """ω·a²·√(ρ/D), ν = 0.3: the books' values, which an energy method gives too (test_plates)."""
    f = hertz(plate(radius=0.2, edges=edges, **STEEL))
    assert f[0] == pytest.approx(number / (2 * math.pi * 0.04) * math.sqrt(D / 7.85), rel=2e-4)


@pytest.mark.hard_for("circle-clamped", "circle-supported", "circle-free")
@pytest.mark.parametrize("edges", ["supported", "clamped", "free"])
@pytest.mark.parametrize("form", [{"size": [0.4, 0.25]}, {"radius": 0.2}], ids=["rectangle", "circle"])
def test_a_frequency_tunes_the_first_mode(edges, form):
    f = hertz(plate(frequency=93.0, edges=edges, area_density=7.85, modes=12, **form))
    assert f[0] == pytest.approx(93.0, rel=1e-6)
    stiff = hertz(plate(edges=edges, modes=12, **STEEL, **form))
    np.testing.assert_allclose(f[:12] / f[0], stiff[:12] / stiff[0], rtol=1e-6)


def test_retuning_moves_all_partials_alike():
    for body in (
        plate(size=[0.4, 0.25], edges="clamped", modes=20, **STEEL),
        plate(size=[0.4, 0.3], frequency=50.0, area_density=3),
    ):
        np.testing.assert_allclose(hertz(body.retuned(1.5)), 1.5 * body.modal_body(5_000.0 / 1.5).omega / 2 / math.pi)


def test_a_tight_plate_is_nearly_a_membrane_and_a_slack_one_nearly_a_plate():
    """Supported: ρω² = D·β⁴ + T·β², exactly."""
    beta2 = math.pi**2 * (1 / 0.16 + 1 / 0.0625)
    f = hertz(plate(size=[0.4, 0.25], tension=2e3, **STEEL))
    assert f[0] == pytest.approx(math.sqrt((D * beta2**2 + 2e3 * beta2) / 7.85) / (2 * math.pi), rel=1e-12)
    tight = plate(radius=0.2, edges="clamped", area_density=0.3, flexural_rigidity=1e-6, tension=2e3, modes=5)
    drum = Membrane(name="m", kind="membrane", radius=0.2, area_density=0.3, tension=2e3, modes=5)
    np.testing.assert_allclose(hertz(tight), hertz(drum), rtol=3e-4)


def test_wood_is_stiff_along_its_grain():
    """Hinged, with Huber's shear modulus: ρω² = Dx·kx⁴ + 2·H·kx²·ky² + Dy·ky⁴, H = D1 + 2·Dk."""
    ex, ey, nu, h = 1.1e10, 8.6e8, 0.37, 8e-3
    f = hertz(plate(size=[1.2, 0.8], young=[ex, ey], poisson=nu, thickness=h, area_density=3.2, modes=30))
    nu_yx = nu * ey / ex
    dx, dy = (e * h**3 / 12 / (1 - nu * nu_yx) for e in (ex, ey))
    g = math.sqrt(ex * ey) / 2 / (1 + math.sqrt(nu * nu_yx))
    both = nu_yx * dx + 2 * g * h**3 / 12
    m, n = np.mgrid[1:40, 1:40]
    x, y = (m * math.pi / 1.2) ** 2, (n * math.pi / 0.8) ** 2
    wanted = np.sort(np.sqrt((dx * x**2 + 2 * both * x * y + dy * y**2) / 3.2).ravel())[:30] / 2 / math.pi
    np.testing.assert_allclose(f, wanted, rtol=1e-12)


@pytest.mark.parametrize("edges", ["supported", "clamped", "free"])
@pytest.mark.parametrize(
    ("poisson", "ratio"), [({}, 4.0), ({}, 40.0), ({"poisson": 0.37}, 15.0), ({"poisson": 0.0}, 9.0)]
)
def test_wood_may_have_its_sides_the_other_way_round(edges, poisson, ratio):
    """Turned by a right angle, positions and all, it is the same plate: its ratio is that of the grain's direction,
    where none is given, and where another would be impossible."""
    wood = {"thickness": 3e-3, "area_density": 1.5, "edges": edges, "modes": 12} | poisson
    one = plate(size=[0.43, 0.31], young=[ratio * 8e8, 8e8], **wood).modal_body(5_000.0)
    other = plate(size=[0.31, 0.43], young=[8e8, ratio * 8e8], **wood).modal_body(5_000.0)
    np.testing.assert_allclose(other.omega, one.omega, rtol=1e-9)
    x, y = 0.37, 0.81
    np.testing.assert_allclose(abs(other.shape([y, x]))[:6], abs(one.shape([x, y]))[:6], rtol=1e-6, atol=1e-9)


def test_a_turned_plate_sounds_the_same():
    wood = {"name": "p", "kind": "plate", "thickness": 3e-3, "area_density": 1.5, "modes": 20, "sigma0": 3.0}
    bodies = {"size": [0.4, 0.3], "young": [1.2e10, 8e8]}, {"size": [0.3, 0.4], "young": [8e8, 1.2e10]}
    heard = []
    for body, turn in zip(bodies, (1, -1), strict=True):
        push = {"body": "p", "kind": "half_sine", "at": [0.2, 0.6][::turn], "amplitude": 5.0, "duration": 1e-3}
        pickup = [{"body": "p", "at": [0.7, 0.35][::turn]}]
        heard.append(engine.render(scene([wood | body], pickup=pickup, force=[push], seconds=0.05)).audio)
    np.testing.assert_allclose(heard[1], heard[0], atol=1e-9 * abs(heard[0]).max())


@pytest.mark.hard
def test_a_free_plate_moves_as_a_whole_when_it_is_struck():
    """A short push of impulse J in the middle of a plate that floats: its centre of mass moves with J/m."""
    body = {"name": "p", "kind": "plate", "size": [0.4, 0.25], "edges": "free", "modes": 30} | STEEL
    body |= {"cords": {"frequency": 0.0}}
    push = {"body": "p", "kind": "half_sine", "at": [0.5, 0.5], "amplitude": 50.0, "duration": 1e-3}
    places = [[(i + 0.5) / 20, (j + 0.5) / 20] for i in range(20) for j in range(20)]
    pickup = [{"body": "p", "at": places, "quantity": "velocity"}]
    audio = engine.render(scene([body], pickup=pickup, force=[push], seconds=0.05)).audio[:, 0]
    assert np.mean(audio[-200:]) == pytest.approx(50.0 * 2e-3 / math.pi / (7.85 * 0.1), rel=2e-3)


def test_a_free_plate_bounces_on_its_cords():
    body = plate(size=[0.4, 0.25], edges="free", modes=3, cords={"frequency": 7.0, "t60": 0.3}, **STEEL)
    modal = body.modal_body(5_000.0)
    np.testing.assert_allclose(modal.omega[-3:], 2 * math.pi * 7.0)
    assert modal.omega.size == 6
    np.testing.assert_allclose(np.linalg.norm(modal.shape([0.5, 0.5])[-3:]), 1 / math.sqrt(7.85 * 0.1), rtol=1e-9)


BAD = [
    ({"size": [0.4, 0.3], "young": 2e11}, "no thickness is given; young in Pa and thickness in m go together"),
    (
        {"size": [0.4, 0.3], "flexural_rigidity": 20.0, "shear": 1e9},
        "a shear modulus is given without two Young's moduli",
    ),
    ({"radius": 0.3, "young": [1e10, 1e9], "thickness": 1e-3}, "a circle of wood; one modulus, or a rectangle"),
    ({"size": [0.4, 0.3], "flexural_rigidity": 20.0, "tension": 5.0, "edges": "free"}, "a free plate under tension"),
    ({"size": [0.4, 0.3], "frequency": 20.0, "tension": 5.0}, "tension and frequency are both given"),
    ({"size": [0.4, 0.3], "flexural_rigidity": 20.0, "cords": {}}, "cords under a plate that is supported"),
    (
        {"size": [0.4, 0.3], "flexural_rigidity": 20.0, "frequency": 5.0},
        "both flexural_rigidity and frequency are given",
    ),
    ({"size": [0.4, 0.3]}, "neither flexural_rigidity nor frequency nor young is given"),
]


@pytest.mark.parametrize(("keys", "says"), BAD)
def test_what_is_wrong_with_a_plate_is_said(keys, says):
    with pytest.raises(ValueError) as error:
        scene([{"name": "p", "kind": "plate", "area_density": 3.0} | keys], pickup=[{"body": "p", "at": [0.1, 0.2]}])
    assert says in str(error.value)
