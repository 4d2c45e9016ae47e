"""What strings, bars and sheets begin with, against Fourier series of the books and the motion that follows."""

import math

import numpy as np
import pytest
from conftest import mostly_hard

import engine
from bench.scenes.small import scene
from engine.bodies import Bar, Membrane, Plate, String

L, MASS = 0.62, 3.93e-3


def string(**more) -> String:
    return String(**{"name": "s", "kind": "string", "length": L, "mass": MASS, "frequency": 261.6} | more)


def keys(body) -> dict:
    return body.model_dump(exclude_unset=True)


def displacement_at(body, at) -> float:
    modal = body.modal_body(21_609.0)
    return float(modal.shape(at) @ modal.q)


@pytest.mark.parametrize("at", [0.5, 0.2, 1 / 7, 0.97])
def test_a_pulled_string_is_the_fourier_series_of_a_triangle(at):
    """y = Σ 2·h/(n²π²·a·(1 - a))·sin(nπa)·sin(nπx) (Fletcher & Rossing, sec. 2.6)."""
    body = string(displacement={"kind": "triangle", "at": at, "amplitude": 2e-3}).modal_body(21_609.0)
    n = np.arange(1, body.q.size + 1)
    wanted = 2 * 2e-3 / (n**2 * math.pi**2 * at * (1 - at)) * np.sin(n * math.pi * at)
    np.testing.assert_allclose(body.q / math.sqrt(MASS / 2), wanted, atol=1e-11)
    assert not body.p.any()


def test_the_energy_of_a_pulled_string_is_that_of_its_triangle():
    """½·T·h²/(L·a·(1 - a)), less what the modes that are left out would hold; a render says it."""
    body = string(displacement={"kind": "triangle", "at": 0.3, "amplitude": 1e-3}, modes=80)
    tension = (2 * L * 261.6) ** 2 * MASS / L
    result = engine.render(scene([keys(body)], pickup=[{"body": "s", "at": 0.2}], seconds=0.1))
    wanted = 0.5 * tension * 1e-3**2 / (L * 0.3 * 0.7)
    assert result.stats.energy.initial == pytest.approx(wanted, rel=0.01)
    assert result.stats.energy.initial < wanted


def test_a_pulled_string_moves_as_d_alembert_says():
    """A triangle of an ideal string splits into two that travel: at the place opposite it stands upside down after half
    a period."""
    body = string(frequency=100.0, displacement={"kind": "triangle", "at": 0.2, "amplitude": 1e-3}, modes=200)
    pickups = [{"body": "s", "at": x, "quantity": "displacement", "channel": n} for n, x in ((1, 0.2), (2, 0.8))]
    rate = 48_000
    audio = engine.render(scene([keys(body)], pickup=pickups, seconds=0.02), samplerate=rate).audio
    half = rate // 200
    assert audio[half, 1] == pytest.approx(-1e-3, rel=0.01)
    assert audio[2 * half, 0] == pytest.approx(1e-3, rel=0.01)
    kink = audio[: half // 5 - 2, 0]  # the two halves run apart at the speed of the wave
    time = np.arange(kink.size) / rate
    slopes = 1e-3 / (0.2 * L), 1e-3 / (0.8 * L)
    np.testing.assert_allclose(kink, 1e-3 - 2 * L * 100.0 * time * sum(slopes) / 2, atol=1.5e-5)


@pytest.mark.parametrize("number", [1, 2, 9])
def test_a_mode_alone_sounds_alone(number):
    body = string(displacement={"kind": "mode", "number": number, "amplitude": 1e-3})
    modal = body.modal_body(21_609.0)
    assert np.flatnonzero(modal.q).tolist() == [number - 1]
    assert modal.q[number - 1] == pytest.approx(1e-3 * math.sqrt(MASS / 2), rel=2e-3)


def test_a_velocity_is_a_shape_too():
    body = string(velocity={"kind": "mode", "number": 3, "amplitude": 2.0}).modal_body(21_609.0)
    assert not body.q.any()
    assert body.p[2] == pytest.approx(2.0 * math.sqrt(MASS / 2), rel=2e-3)


def test_a_file_of_points_is_linear_between_them(tmp_path):
    """Two points and the ends are the triangle."""
    (tmp_path / "shape.csv").write_text("x,value\n0,0\n0.3,1.5e-3\n1,0\n")
    (tmp_path / "p.toml").write_text(
        f'[[body]]\nname = "s"\nkind = "string"\nlength = {L}\nmass = {MASS}\nfrequency = 261.6\n'
        'displacement = { kind = "points", file = "shape.csv", scale = 2.0 }\n[[pickup]]\nbody = "s"\nat = 0.2\n'
    )
    own = engine.load(tmp_path / "p.toml").body[0].modal_body(21_609.0)
    triangle = string(displacement={"kind": "triangle", "at": 0.3, "amplitude": 3e-3}).modal_body(21_609.0)
    np.testing.assert_allclose(own.q, triangle.q, atol=1e-12)


SHEETS = {
    "circle": Membrane(name="m", kind="membrane", area_density=0.3, frequency=100.0, radius=0.2, modes=600),
    "rectangle": Membrane(name="m", kind="membrane", area_density=0.3, frequency=100.0, size=[0.4, 0.3], modes=600),
    "plate": Plate(name="p", kind="plate", area_density=7.8, frequency=80.0, size=[0.5, 0.3], modes=600),
}


@pytest.mark.hard
@pytest.mark.parametrize("body", SHEETS.values(), ids=SHEETS)
def test_a_sheet_pulled_aside_is_a_cone(body):
    """Largest where it is held, half of it half way to the rim."""
    begin = {"kind": "triangle", "at": [0.5, 0.5], "amplitude": 2e-3}
    pulled = type(body)(**keys(body) | {"displacement": begin})
    assert displacement_at(pulled, [0.5, 0.5]) == pytest.approx(2e-3, rel=0.1)
    assert displacement_at(pulled, [0.75, 0.5]) == pytest.approx(1e-3, rel=0.02)
    assert displacement_at(pulled, [0.5, 0.25]) == pytest.approx(1e-3, rel=0.02)


@pytest.mark.hard
@pytest.mark.parametrize("body", SHEETS.values(), ids=SHEETS)
def test_points_on_a_sheet(body):
    """A grid of points of a smooth shape, which stays what it is."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41)))

    def bump(a, b):
        return 1e-3 * np.exp(-60 * ((a - 0.45) ** 2 + (b - 0.5) ** 2))

    begin = {"kind": "points", "x": x.tolist(), "y": y.tolist(), "value": bump(x, y).tolist()}
    moved = type(body)(**keys(body) | {"velocity": begin})
    modal = moved.modal_body(21_609.0)
    for at in ([0.45, 0.5], [0.6, 0.6], [0.35, 0.42]):
        assert modal.shape(at) @ modal.p == pytest.approx(bump(*at), abs=1.5e-5)
    assert not modal.q.any()


def test_a_bar_keeps_the_shape_it_begins_with():
    """A clamped bar in its first mode swings at its own frequency, between the two amplitudes."""
    begin = {"kind": "mode", "amplitude": 1e-3}
    bar = {"name": "b", "kind": "bar", "length": 0.4, "mass": 0.2, "frequency": 100.0, "ends": "clamped"}
    body = Bar(**bar | {"displacement": begin})
    pickup = [{"body": "b", "at": 0.5, "quantity": "displacement"}]
    audio = engine.render(scene([keys(body)], pickup=pickup, seconds=0.05), samplerate=48_000).audio[:, 0]
    time = np.arange(audio.size) / 48_000
    np.testing.assert_allclose(audio, 1e-3 * np.cos(2 * math.pi * 100.0 * time), atol=3e-8)


def test_a_mode_that_is_not_there_is_refused():
    body = string(displacement={"kind": "mode", "number": 500, "amplitude": 1e-3})
    with pytest.raises(engine.BuildError, match="has no mode 500, but 82 at this sample rate; a lower one"):
        engine.render(scene([keys(body)], pickup=[{"body": "s", "at": 0.2}], seconds=0.1))


@pytest.mark.hard_for("200-circle")
@pytest.mark.parametrize("kind", ["rectangle", "circle"])
@pytest.mark.parametrize("modes", mostly_hard([200, 3000], 200))
def test_the_energy_of_a_cone_does_not_grow_with_the_modes(kind, modes):
    """½·T·∫|∇y|² of the shape itself, from which the modes that are left out are missing."""
    body = SHEETS[kind].model_copy(update={"modes": modes})
    begin = {"kind": "triangle", "at": [0.5, 0.5], "amplitude": 1e-3}
    modal = type(body)(**keys(body) | {"displacement": begin}).modal_body(math.inf)
    energy = float(np.sum((modal.omega * modal.q) ** 2) / 2)
    if kind == "circle":  # slope h/a
        tension = 0.3 * (2 * math.pi * 100.0 * 0.2 / 2.404825557695773) ** 2
        exact = 0.5 * tension * math.pi * 1e-6
    else:  # 2h/a on two of the triangles, 2h/b on the others
        tension = 0.3 * (2 * math.pi * 100.0) ** 2 / (math.pi**2 * (1 / 0.4**2 + 1 / 0.3**2))
        exact = 0.5 * tension * 0.12 * 2e-6 * (1 / 0.4**2 + 1 / 0.3**2)
    assert energy < exact * (1 + 1e-3)
    assert energy == pytest.approx(exact, rel=0.05 if modes == 200 else 0.02)


@pytest.mark.hard
def test_a_mode_is_as_large_as_asked_where_it_is_largest():
    """At the free end of a bar, which no point of a quadrature is."""
    bar = {"name": "b", "kind": "bar", "length": 0.4, "mass": 0.2, "frequency": 100.0, "modes": 5}
    body = Bar(**bar | {"displacement": {"kind": "mode", "number": 2, "amplitude": 1e-3}})
    assert abs(displacement_at(body, 0.0)) == pytest.approx(1e-3, rel=1e-9)
    disc = Plate(name="p", kind="plate", area_density=7.8, frequency=80.0, radius=0.2, edges="free", modes=8,
                 displacement={"kind": "mode", "amplitude": 1e-3})  # fmt: skip
    rim = max(
        abs(displacement_at(disc, [0.5 + 0.5 * math.cos(t), 0.5 + 0.5 * math.sin(t)])) for t in np.linspace(0, 7, 50)
    )
    assert rim == pytest.approx(1e-3, rel=2e-3)


def test_points_on_a_line_are_no_sheet():
    begin = {"kind": "points", "x": [0.1, 0.5, 0.9], "y": [0.5, 0.5, 0.5], "value": [0.0, 1e-3, 0.0]}
    body = keys(SHEETS["rectangle"]) | {"displacement": begin}
    with pytest.raises(engine.BuildError, match="begins with points that lie on a line"):
        engine.render(scene([body], pickup=[{"body": "m", "at": [0.2, 0.3]}], seconds=0.1))


def test_a_file_and_lists_exclude_each_other(tmp_path):
    (tmp_path / "shape.csv").write_text("x,value\n0,0\n1,0\n")
    (tmp_path / "p.toml").write_text(
        f'[[body]]\nname = "s"\nkind = "string"\nlength = {L}\nmass = {MASS}\nfrequency = 261.6\n'
        'displacement = { kind = "points", file = "shape.csv", x = [0.0, 1.0] }\n[[pickup]]\nbody = "s"\nat = 0.2\n'
    )
    with pytest.raises(engine.PatchError, match="file and x are both given; give one of them"):
        engine.load(tmp_path / "p.toml")
