"""Air that bodies press on: boxes with and without a hole, drums with two heads, tubes; against the books."""

import math

import numpy as np
import pytest
import scipy
from poles import engine_poles, exact_poles

import engine
from bench.scenes.small import scene
from engine.bodies import AirBox, Membrane, Tube

RHO, C = 1.204, 343.2
BOX = {
    "name": "box",
    "kind": "air",
    "size": [0.48, 0.36, 0.1],
    "hole": {"radius": 0.05, "thickness": 0.003},
    "modes": 6,
}
TOP = {
    "name": "top",
    "kind": "plate",
    "size": [0.48, 0.36],
    "area_density": 1.4,
    "frequency": 180.0,
    "modes": 12,
    "sigma0": 9.0,
}
HEARD = [{"body": "top", "at": [0.4, 0.45]}]
JOIN = {"kind": "air", "body": "top", "on": "box"}


def two_heads(volume: float | None = 0.014, **more) -> engine.Scene:
    batter = {"name": "top", "kind": "membrane", "radius": 0.178, "area_density": 0.26, "frequency": 180.0, "modes": 30}
    snare = batter | {"name": "low", "area_density": 0.11, "frequency": 250.0}
    air = [{"kind": "air", "body": "top", "on": "low", "volume": volume}] if volume else []
    return scene([batter, snare], connection=air, pickup=HEARD, **more)


def test_helmholtz():
    """ω² = c²·S/(V·l), l the thickness and two end corrections of 0.85 radii; standing waves of a rigid box."""
    modal = AirBox(**BOX).modal_body(20_000.0)
    wanted = C / (2 * math.pi) * math.sqrt(math.pi * 0.05**2 / (0.48 * 0.36 * 0.1 * (0.003 + 2 * 0.85 * 0.05)))
    assert modal.omega[0] / (2 * math.pi) == pytest.approx(wanted, rel=1e-12)
    waves = sorted(
        C / 2 * math.hypot(i / 0.48, j / 0.36, k / 0.1) for i in range(5) for j in range(5) for k in range(3)
    )
    np.testing.assert_allclose(modal.omega[1:] / (2 * math.pi), waves[1:7], rtol=1e-12)
    assert modal.omega[1] / (2 * math.pi) == pytest.approx(C / 2 / 0.48)


def test_a_box_loses_what_its_hole_radiates_and_what_its_walls_take():
    """σ = P/2E of the plug: a monopole radiates P = ρc·k²·(S·u)²/8π, and E = ½ρS·l·u² (Pierce, Acoustics, sec. 4.3);
    the walls of the hole take what those of a tube take; standing waves have qualities of some hundreds."""
    modal = AirBox(**BOX).modal_body(20_000.0)
    area, length, k = math.pi * 0.05**2, 0.003 + 2 * 0.85 * 0.05, modal.omega[0] / C
    radiated = RHO * C * k**2 * area**2 / (8 * math.pi) / (RHO * area * length)
    walls = C * 3e-5 * math.sqrt(modal.omega[0] / (2 * math.pi)) / 0.05
    assert modal.sigma[0] == pytest.approx(radiated + walls, rel=1e-12)
    quality = modal.omega / (2 * modal.sigma)
    assert 20 < quality[0] < 100
    assert np.all((quality[1:] > 200) & (quality[1:] < 1000))


def test_a_box_rings_for_ever_only_if_it_is_asked_to():
    push = [{"body": "box", "kind": "half_sine", "at": "hole", "amplitude": 1.0, "duration": 2e-3}]
    for loss, fallen in (({}, 60.0), ({"sigma0": 0.0}, 0.0)):
        audio = engine.render(
            scene([BOX | loss], force=push, pickup=[{"body": "box"}]), seconds=1.1, silence=-math.inf
        ).audio[:, 0]
        first, last = (np.abs(audio[round(t * 44_100) :][:2205]).max() for t in (0.01, 1.0))
        assert 20 * math.log10(first / last) == pytest.approx(fallen, abs=0.1 if loss else 25)


def test_a_top_of_one_mode_and_a_hole_are_two_coupled_oscillators():
    """Plate and plug share the spring of the air: the poles of the two-by-two matrix, as in the model of a guitar by
    Christensen & Vistisen (JASA 68, 1980)."""
    box, top = BOX | {"modes": 1}, TOP | {"modes": 1, "sigma0": 0.0}
    told = scene(
        [top, box], connection=[JOIN], pickup=HEARD
    )  # whose wave, along x, the plate's first mode does not drive
    poles = np.imag(engine_poles(told, samplerate=88_200))
    volume, area = 0.48 * 0.36 * 0.1, math.pi * 0.05**2
    push = 4 / math.pi**2 * 0.48 * 0.36 * 2 / math.sqrt(1.4 * 0.48 * 0.36)  # ∬Φ dA of the first mode
    mass = RHO * area * (0.003 + 2 * 0.85 * 0.05)
    k = RHO * C**2 / volume
    v = np.array([push, area / math.sqrt(mass)])
    matrix = k * np.outer(v, v) + np.diag([(2 * math.pi * 180.0) ** 2, 0.0])
    wave = math.pi * C / 0.48
    wanted = np.sqrt(np.linalg.eigvalsh(matrix))
    assert len(wanted) == 2
    for omega in wanted:
        assert np.min(np.abs(poles[np.abs(poles - wave) > 1.0] / omega - 1)) < 1e-4


@pytest.mark.parametrize("walls", [1, 2])
def test_poles_of_a_box_with_plates(walls):
    """As the state space of the same modes."""
    low = TOP | {"name": "low", "frequency": 140.0}
    joins = [JOIN, {"kind": "air", "body": "low", "on": "box", "wall": "bottom"}][:walls]
    told = scene([TOP, low, BOX] if walls == 2 else [TOP, BOX], connection=joins, pickup=HEARD)
    own, exact = engine_poles(told), exact_poles(told)
    slow = np.imag(exact) < 2 * math.pi * 1500
    cents = 1200 * np.log2(np.imag(own[: slow.sum()]) / np.imag(exact[slow]))
    assert np.abs(cents).max() < 0.5
    np.testing.assert_allclose(np.real(own[: slow.sum()]), np.real(exact[slow]), rtol=0.02, atol=0.02)


def test_the_air_in_a_drum_splits_the_first_mode_of_two_heads():
    """K·(U₁ - U₂)²/2 with K = ρc²/V, on the symmetrical modes of both heads: the eigenvalues of that matrix."""
    z = scipy.special.jn_zeros(0, 5)
    diagonal, push = [], []
    for density, first, sign in ((0.26, 180.0, 1.0), (0.11, 250.0, -1.0)):
        omega = 2 * math.pi * first * z / z[0]
        diagonal += list(omega[omega < 2 * math.pi * 950] ** 2)
        volume = 2 * math.pi * 0.178**2 / z / math.sqrt(density * math.pi * 0.178**2)
        push += list(sign * volume[omega < 2 * math.pi * 950])
    matrix = np.diag(diagonal) + RHO * C**2 / 0.014 * np.outer(push, push)
    wanted = np.sqrt(np.linalg.eigvalsh(matrix))[:2]
    poles = np.imag(engine_poles(two_heads()))
    for omega in wanted:  # in the sea of modes that move no air
        assert np.min(np.abs(poles / omega - 1)) < 3e-3
    assert wanted[1] / wanted[0] > 1.5


@pytest.mark.hard_for("4")
@pytest.mark.parametrize("order", [2, 4])
def test_its_energy_is_exact(order):
    push = [{"body": "top", "kind": "half_sine", "at": [0.4, 0.55], "amplitude": 30.0, "duration": 2e-3}]
    for told in (two_heads(force=push), scene([TOP, BOX], connection=[JOIN], pickup=HEARD, force=push)):
        result = engine.render(told, seconds=1.0, order=order)
        assert result.stats.energy.error_max < 1e-13


def test_a_closed_kettle_raises_the_first_mode_of_a_drum():
    """ω² + ρc²/V·(∬Φ dA)² of the first mode, less what the other symmetrical modes give way."""
    drum = {"name": "top", "kind": "membrane", "radius": 0.3, "area_density": 0.26, "frequency": 80.0, "modes": 25}
    told = scene([drum], connection=[{"kind": "air", "body": "top", "volume": 0.14}], pickup=HEARD)
    z = scipy.special.jn_zeros(0, 9)
    omega = 2 * math.pi * 80.0 * z / z[0]
    omega = omega[omega <= Membrane(**drum).modal_body().omega.max() * (1 + 1e-9)]
    push = 2 * math.pi * 0.3**2 / z[: omega.size] / math.sqrt(0.26 * math.pi * 0.3**2)
    wanted = math.sqrt(np.linalg.eigvalsh(np.diag(omega**2) + RHO * C**2 / 0.14 * np.outer(push, push))[0])
    raised = np.imag(engine_poles(told))
    assert np.min(np.abs(raised / wanted - 1)) < 1e-4
    assert omega[0] < 0.9 * wanted


def test_a_tube():
    """Odd quarter-waves of a closed tube, half-waves of an open one, longer by 0.61 of the radius at each open end; the
    quality of the lowest resonance is some tens, as of organ pipes."""
    closed = Tube(name="t", kind="tube", length=0.6, radius=0.02).modal_body(3000.0)
    f = closed.omega / (2 * math.pi)
    np.testing.assert_allclose(f, (2 * np.arange(1, f.size + 1) - 1) * C / 4 / (0.6 + 0.61 * 0.02), rtol=1e-12)
    opened = Tube(name="t", kind="tube", length=0.6, radius=0.02, ends="open").modal_body(3000.0)
    assert opened.omega[0] / (2 * math.pi) == pytest.approx(C / 2 / (0.6 + 1.22 * 0.02), rel=1e-12)
    assert 20 < closed.omega[0] / (2 * closed.sigma[0]) < 100
    np.testing.assert_allclose(closed.shape(1.0) ** 2, 2 / (RHO * math.pi * 0.02**2 * 0.6))
    np.testing.assert_allclose(closed.shape(0.0), 0.0, atol=1e-9)


def test_what_flows_out_of_a_hole_is_heard():
    """p = ρ/(2πr)·dU/dt of the plug that a push on the plate sets off."""
    push = [{"body": "top", "kind": "half_sine", "at": [0.4, 0.55], "amplitude": 30.0, "duration": 2e-3}]
    heard = [{"body": "box"}, {"body": "box", "at": "hole", "quantity": "acceleration", "channel": 2}]
    audio = engine.render(scene([TOP, BOX], connection=[JOIN], pickup=heard, force=push), seconds=0.2).audio
    np.testing.assert_allclose(audio[:, 0], RHO / (2 * math.pi) * math.pi * 0.05**2 * audio[:, 1], atol=1e-12)
    assert np.abs(audio[:, 0]).max() > 1e-3


BAD = [
    ({"body": "hammer", "on": "box"}, '"hammer" is of kind "mass", which cannot be next to air'),
    ({"body": "top", "on": "hammer", "volume": 0.1}, '"hammer" is of kind "mass", which cannot be next to air'),
    ({"body": "top", "on": "box", "volume": 0.1}, "a volume is given; the air of a box has its own"),
    ({"body": "top"}, "no volume is given; give its volume in m³"),
    ({"body": "top", "on": "top", "volume": 0.1}, "both sides are the same body"),
    ({"body": "drum", "on": "box"}, '"drum" is a circle, which cannot be a wall of a box'),
    ({"body": "top", "volume": 0.1, "wall": "top"}, "a wall is given without a box"),
    ({"body": "top", "on": "tube"}, '"tube" is of kind "tube", which cannot be next to air'),
]


@pytest.mark.parametrize(("keys", "says"), BAD)
def test_what_is_wrong_with_air_is_said(keys, says):
    drum = {"name": "drum", "kind": "membrane", "radius": 0.2, "area_density": 0.3, "frequency": 100.0}
    with pytest.raises(ValueError) as error:
        tube = {"name": "tube", "kind": "tube", "length": 0.5, "radius": 0.02}
        bodies = [TOP, BOX, drum, tube, {"name": "hammer", "kind": "mass", "mass": 1.0}]
        scene(bodies, connection=[{"kind": "air"} | keys], pickup=HEARD)
    assert says in str(error.value)


def test_a_tube_is_tuned_by_its_length():
    tube = Tube(name="t", kind="tube", length=0.6, radius=0.02)
    f, higher = (t.modal_body(3000.0).omega[:3] for t in (tube, tube.retuned(1.5)))
    np.testing.assert_allclose(higher, 1.5 * f, rtol=1e-12)


def test_a_wall_has_one_sheet():
    with pytest.raises(ValueError, match="another body is already its top; give the other wall"):
        scene([TOP, TOP | {"name": "other"}, BOX], connection=[JOIN, JOIN | {"body": "other"}], pickup=HEARD)


def test_a_box_without_a_hole_is_not_heard():
    closed = {key: value for key, value in BOX.items() if key != "hole"}
    with pytest.raises(ValueError, match='"box" has no hole, and does not radiate'):
        scene([TOP, closed], connection=[JOIN], pickup=[{"body": "box"}])


def test_a_hole_too_high_for_the_sample_rate_is_refused():
    tiny = BOX | {"size": [1e-3, 1e-3, 1e-3], "hole": {"radius": 4e-4}}
    with pytest.raises(engine.BuildError, match="has a hole that resonates above"):
        engine.render(scene([tiny, TOP], connection=[JOIN], pickup=HEARD), seconds=0.1)
