"""Contacts of a width: what touches a sheet, a string or a bar feels the mean motion of what it covers; and what the
modes that are left out would give way under it is there."""

import math

import numpy as np
import pytest

import engine
from bench.scenes.small import scene
from engine.assembly.build import build
from engine.bodies.tips import Tip, sum_waves

RATE = 44_100
STICK = {"name": "stick", "kind": "mass", "mass": 0.02, "displacement": -1e-6, "velocity": 3.0}
BLOW = {"body": "stick", "on": "head", "on_at": [0.5, 0.62], "stiffness": 5e7, "exponent": 1.5}
HEARD = [{"body": "stick", "quantity": "force"}]
HEADS = {  # radius, m; density, kg/m²; tension, N/m
    "snare drum": (0.18, 0.3, 2500.0),
    "tom": (0.165, 0.25, 3000.0),
    "conga": (0.14, 0.4, 4000.0),
}


def head(name: str, **more) -> dict:
    radius, density, tension = HEADS[name]
    table = {"name": "head", "kind": "membrane", "radius": radius, "area_density": density, "tension": tension}
    return table | {"sigma0": 2.0} | more


def blow(body: dict, radius: float | None, **accuracy) -> np.ndarray:
    """How long the first touch lasts, and all of the blow, s, and the largest force, N."""
    contact = BLOW | ({} if radius is None else {"radius": radius})
    struck = scene([body, STICK], contact=[contact], pickup=HEARD, seconds=0.015)
    force = -engine.render(struck, **accuracy).audio[:, 0]
    changes = np.flatnonzero(np.diff((force > 1e-9).astype(int), prepend=0))
    return np.array([(changes[1] - changes[0]) / RATE, (changes[-1] - changes[0]) / RATE, force.max()])


@pytest.mark.parametrize("radius", [0.003, 0.005, 0.008])
@pytest.mark.parametrize(
    "name", [pytest.param("tom"), *(pytest.param(n, marks=pytest.mark.hard) for n in HEADS if n != "tom")]
)
def test_a_stick_on_a_head_touches_as_long_and_as_hard_as_many_modes_say(name, radius):
    """By default; against modes averaged over the same disc, doubled until nothing changes by more than 1 %, or the
    sample rate allows no more."""
    numbers = [4000, 8000, 16_000, 20_000]
    coarse = blow(head(name, modes=numbers.pop(0), residual=False), radius)
    while numbers:
        fine = blow(head(name, modes=numbers.pop(0), residual=False), radius)
        is_settled = np.allclose(coarse, fine, rtol=0.01)
        coarse = fine
        if is_settled:
            break
    assert is_settled
    np.testing.assert_allclose(blow(head(name), radius), fine, rtol=0.05)


@pytest.mark.parametrize("accuracy", [{"substeps": 4}, {"order": 4}, {"order": 6}, {"order": 4, "substeps": 2}])
def test_finer_steps_find_the_same_blow(accuracy):
    np.testing.assert_allclose(blow(head("snare drum"), None, **accuracy), blow(head("snare drum"), None), rtol=0.01)


def test_a_contact_on_a_membrane_is_five_millimetres_wide_and_a_point_if_it_says_so():
    """A point has no limit: it has no residual modes, and chatters."""
    np.testing.assert_array_equal(blow(head("tom"), None), blow(head("tom"), 0.005))
    touched = {r: scene([head("tom"), STICK], contact=[BLOW | {"radius": r}], pickup=HEARD) for r in (0.0, 0.005)}
    assert {r: build(one, RATE).layout.modal_bodies[0].residual for r, one in touched.items()} == {0.0: 0, 0.005: 13}
    point, tip = blow(head("tom"), 0.0), blow(head("tom"), None)
    assert point[2] > 1.1 * tip[2]


BODIES = {
    "string": ({"kind": "string", "length": 0.6, "mass": 4e-3, "tension": 70.0, "modes": 40}, 0.13),
    "string near its end": ({"kind": "string", "length": 0.6, "mass": 4e-3, "tension": 70.0, "modes": 40}, 0.01),
    "string of two directions": (
        {"kind": "string", "length": 0.6, "mass": 4e-3, "tension": 70.0, "modes": 20, "polarisations": 2},
        0.4,
    ),
    "bar": ({"kind": "bar", "length": 0.3, "mass": 0.2, "frequency": 200.0, "modes": 9}, 0.45),
    "round head": (head("tom", modes=200), [0.4, 0.7]),
    "rectangular head": (
        {"kind": "membrane", "size": [0.3, 0.2], "area_density": 0.3, "tension": 2000.0, "modes": 150},
        [0.3, 0.6],
    ),
    "clamped plate": (
        {"kind": "plate", "size": [0.3, 0.2], "area_density": 7.8, "flexural_rigidity": 20.0, "modes": 40}
        | {"edges": "clamped"},
        [0.3, 0.6],
    ),
    "round plate": (
        {"kind": "plate", "radius": 0.15, "area_density": 7.8, "flexural_rigidity": 20.0, "modes": 40, "edges": "free"},
        [0.3, 0.6],
    ),
    "shell": (
        {"kind": "shell", "radius": 0.15, "length": 0.2, "thickness": 2e-3, "young": 7e10, "density": 2700.0}
        | {"modes": 40},
        [0.3, 0.6],
    ),
}


@pytest.mark.parametrize(("table", "at"), BODIES.values(), ids=BODIES)
def test_a_contact_feels_the_mean_of_what_it_covers(table, at):
    """The mean over a fine grid of points within its radius."""
    told = scene([table | {"name": "s"}], pickup=[{"body": "s", "at": at}])
    body, radius = told.body[0], 0.02
    modal = body.modal_body(20_000.0)
    if isinstance(at, float):
        reach = radius / body.length
        covered = np.linspace(max(0.0, at - reach), at + reach, 4001)
    else:
        grid = (np.arange(61) - 30) / 30.2
        inside = np.array([(x, y) for x in grid for y in grid if math.hypot(x, y) <= 1.0])
        covered = np.array(at) + radius * inside / np.array(body.extent())
    whole = np.mean([np.mean(modal.shape(part), axis=0) * len(part) for part in np.array_split(covered, 20)], axis=0)
    right = whole * 20 / len(covered)
    np.testing.assert_allclose(modal.shape(Tip(at, radius)), right, atol=2e-3 * np.abs(modal.shape(at)).max())


@pytest.mark.hard
def test_what_a_membrane_gives_way_beyond_its_modes_is_that_of_many():
    """Σ Φ²/ω² of averaged modes between two frequencies, in the middle of a large head."""
    told = scene([head("conga", modes=20_000)], pickup=[{"body": "head", "at": [0.5, 0.5]}])
    body, place, other = told.body[0], Tip([0.45, 0.52], 0.006), Tip([0.47, 0.5], 0.004)
    modal = body.modal_body(200_000.0)
    low, high = 2e4, float(modal.omega[-1])
    between = (modal.omega > low) & (modal.omega <= high)
    for a, b in ((place, place), (place, other), (other, [0.43, 0.5])):
        many = float(np.sum((modal.shape(a) * modal.shape(b))[between] / modal.omega[between] ** 2))
        closed = body.compliance_beyond(low, high)(a, [b])[0]
        scale = math.sqrt(math.prod(body.compliance_beyond(low)(x, [x])[0] for x in (place, other)))
        assert abs(closed - many) < 0.02 * scale


@pytest.mark.hard
@pytest.mark.parametrize("edges", ["clamped", "free"])
def test_what_a_plate_of_any_edges_gives_way_beyond_its_modes_is_that_of_more(edges):
    """Of wood, away from the edges: 60 and 400 modes differ by what stands for those between."""
    table = {
        "name": "s",
        "kind": "plate",
        "size": [0.5, 0.4],
        "area_density": 2.0,
        "edges": edges,
        "young": [1.2e10, 1e9],
    }
    table |= {"shear": 7e8, "poisson": 0.37, "thickness": 3e-3}
    at, sums, closed = [0.45, 0.55], [], []
    for count in (60, 400):
        body = scene([table | {"modes": count}], pickup=[{"body": "s", "at": at}]).body[0]
        modal = body.modal_body(1e6)
        moving = modal.omega > 2 * math.pi * 20.0
        sums.append(float(np.sum(modal.shape(at)[moving] ** 2 / modal.omega[moving] ** 2)))
        closed.append(float(body.compliance_beyond(float(modal.omega.max()))(at, [at])[0]))
    assert sums[0] + closed[0] == pytest.approx(sums[1] + closed[1], rel=0.005)
    assert closed[0] - closed[1] == pytest.approx(sums[1] - sums[0], rel=0.25)


def test_the_sum_over_waves_is_that_of_a_quadrature():
    from scipy.integrate import quad
    from scipy.special import j0, j1

    first, second, away, tension, rigidity = 4e-3, 2e-3, 0.01, 100.0, 0.02
    closed = sum_waves((100.0, 4000.0), tension, rigidity, lambda p: p[2], lambda p: np.asarray(p[:2]))

    def integrand(k: float) -> float:
        means = 4 * j1(k * first) * j1(k * second) / (k * first * k * second)
        return means * j0(k * away) / (tension * k + rigidity * k**3) / (2 * math.pi)

    right = quad(integrand, 100.0, 4000.0, limit=200)[0]
    assert closed((0.0, 0.0, first), [(away, 0.0, second)])[0] == pytest.approx(right, rel=1e-6)


def test_a_hard_hammer_is_right_with_residual_modes_and_is_told_what_modes_lack_without():
    """On a long string, until the reflection: v·exp(-2Zt/m)."""
    length, tension, density, mass = 4.0, 600.0, 6e-3, 5e-3
    string = {"name": "s", "kind": "string", "length": length, "tension": tension, "linear_density": density}
    hammer = {"name": "h", "kind": "mass", "mass": mass, "velocity": 1.0}
    contact = {"body": "h", "on": "s", "on_at": 0.5, "stiffness": 1e9, "exponent": 1.0}
    right = np.exp(-2 * math.sqrt(tension * density) * np.arange(220) / RATE / mass)
    with_them, without = (
        scene([string | more, hammer], contact=[contact], pickup=[{"body": "h"}], seconds=0.006)
        for more in ({"residual": True}, {})
    )

    def error(struck: engine.Scene, **accuracy) -> float:
        heard = engine.render(struck, **accuracy).audio[:220, 0]
        return float(np.sqrt(np.mean((heard - right) ** 2) / np.mean(right**2)))

    assert error(with_them) < 7e-4
    finer = [error(with_them, substeps=n) for n in (2, 4, 16)]
    assert max(finer) < 2.5e-4 and finer[1] < 1e-4  # the place gives way as the steps do, up to their Nyquist frequency
    assert error(with_them, order=4) < 2.5e-4 and error(with_them, order=4, substeps=4) < 5e-4
    assert error(without, substeps=16) > 5e-3
    left_out = engine.estimate_error(without, engine.render(without)).left_out
    assert any("of what it gives way at contacts within a sample" in name for name in left_out)
