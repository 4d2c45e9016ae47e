"""Bodies with many modes collide as physics has it."""

import math
import re
import tomllib
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from conftest import slope

import engine

STRING = {
    "name": "string",
    "kind": "string",
    "length": 0.62,
    "mass": 3.93e-3,
    "tension": 670.0,
    "inharmonicity": 3.77e-4,
    "modes": 60,
}
HAMMER = {"name": "hammer", "kind": "mass", "mass": 2.97e-3, "displacement": -1e-3, "velocity": 4.0}
FELT = {"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5}
EAR = {"body": "string", "at": 0.37}


def build(**parts) -> engine.Scene:
    return engine.Scene.model_validate(parts)


def hammered(**more) -> engine.Scene:
    return build(body=[STRING, HAMMER], contact=[FELT], pickup=[EAR], **more)


EVERYTHING = """
gravity = 9.81
seconds = 0.5
body = [
    { name = "string", kind = "string", length = 0.62, mass = 3.93e-3, tension = 670.0, inharmonicity = 3.77e-4,
      modes = 60, sigma0 = 0.5, b3 = 6e-9, support = [{ at = 0.01, stiffness = 1e4, damping_coefficient = 0.5 }] },
    { name = "hammer", kind = "mass", mass = 2.97e-3, displacement = -1e-3, velocity = 4.0 },
    { name = "bar", kind = "bar", length = 0.3, mass = 0.2, frequency = 440.0,
      t60 = [1, 0.5], t60_at = [400, 4e3] },
    { name = "skin", kind = "membrane", radius = 0.2, area_density = 0.26, frequency = 90.0, modes = 80, sigma0 = 4.0 },
    { name = "plate", kind = "plate", size = [0.4, 0.3], area_density = 8.0, flexural_rigidity = 20.0, modes = 60,
      t60 = [2.0] },
    { name = "bell", kind = "modes", frequency = [300.0, 810.0], sigma = [1.0, 2.0], points = { rim = [2.0, 1.5] } },
    { name = "ball", kind = "mass", mass = 0.01, displacement = 0.01 },
    { name = "reed", kind = "oscillator", mass = 1e-3, frequency = 55.0, damping_rate = 2.0, displacement = 3e-3 },
]
contact = [
    { name = "felt", body = "hammer", on = "string", on_at = 0.12, stiffness = 4.5e9, exponent = 2.5, loss = 0.1 },
    { name = "rail", body = "string", bridge = { at = 0.6, width = 0.05, points = 5, depth = 1e-4, height = -1e-3 },
      side = "below", stiffness = 1e8, exponent = 1.5 },
    { body = "string", frets = { count = 6, height = [-8e-4, -2e-3] }, side = "below",
      stiffness = 1e8, exponent = 1.3 },
    { body = "ball", on = "skin", on_at = [0.4, 0.5], side = "below", stiffness = 1e6, exponent = 1.5, loss = 0.2 },
    { body = "skin", at = [[0.3, 0.3], [0.6, 0.7]], on = "plate", on_at = [[0.3, 0.3], [0.6, 0.7]], gap = 1e-4,
      side = "below", stiffness = 1e7, exponent = 2.0 },
    { body = "reed", on = "bell", on_at = "rim", gap = 1e-3, stiffness = 1e6, exponent = 1.0 },
]
force = [{ body = "string", at = 0.5, kind = "pluck", amplitude = -2.0, duration = 0.01 }]
event = [
    { kind = "strike", time = 0.1, body = "hammer", velocity = 3.0 },
    { kind = "pluck", time = 0.15, body = "bar", at = 0.2, amplitude = 20.0, duration = 0.002 },
    { kind = "change", time = 0.2, contact = "rail", barrier = -2e-4, duration = 0.02 },
    { kind = "change", time = 0.25, contact = "felt", stiffness = 1e9, duration = 0.01 },
    { kind = "strike", time = 0.26, body = "hammer", velocity = 2.0 },
    { kind = "damp", time = 0.35, body = "string", sigma = 50.0, duration = 0.1 },
]
pickup = [
    { body = "string", at = 0.37 },
    { body = "plate", at = [0.3, 0.4] },
    { body = "bell", at = "rim", quantity = "force" },
]
"""


def text_scene(text: str) -> engine.Scene:
    """A scene from TOML, whose inline tables may here go over lines."""
    joined = re.sub(r",\n +(?=[a-z_0-9]+ =)", ", ", text)
    return engine.Scene.model_validate(tomllib.loads(joined))


@lru_cache
def everything() -> engine.Rendering:
    """Every kind of body, contact and event in one scene, some in one island, some apart."""
    return engine.render(text_scene(EVERYTHING), trace=True)


@pytest.mark.hard
def test_the_ledger_closes_with_everything_on():
    rendering = everything()
    assert np.isfinite(rendering.audio).all()
    assert rendering.stats["energy"]["error_max"] <= 1e-12
    assert rendering.stats["newton"]["unconverged"] == 0
    assert not {"contact loss", "coupled contacts", "events", "gravity"} & set(rendering.stats["effects"]["left_out"])


def test_every_contact_was_made():
    """Columns of the trace are the points of all contacts, in the order of the patch."""
    force = everything().trace["force"]
    assert force.shape[1] == 1 + 5 + 6 + 1 + 2 + 1
    for first, last in ((0, 1), (1, 6), (6, 12), (12, 13), (13, 15), (15, 16)):
        assert force[:, first:last].max() > 0.0


def test_two_free_bodies_keep_their_momentum():
    """Through a collision of 1 kg with 1 g, at any stiffness; and the faster one bounces as it must."""
    for stiffness in (1e3, 1e7, 1e12):
        bodies = [
            {"name": "a", "kind": "mass", "mass": 1.0, "velocity": 2.0, "displacement": -0.01},
            {"name": "b", "kind": "mass", "mass": 1e-3, "velocity": -1.0},
        ]
        contact = [{"body": "a", "on": "b", "stiffness": stiffness, "exponent": 1.5}]
        rendering = engine.render(build(body=bodies, contact=contact, pickup=[{"body": "a"}]), seconds=0.2, trace=True)
        a, b = rendering.trace["velocity"].T
        momentum = a + 1e-3 * b
        assert np.abs(momentum - momentum[0]).max() <= 1e-14
        assert a[-1] == pytest.approx((2.0 * 0.999 - 2e-3) / 1.001, rel=1e-12)
        assert b[-1] - a[-1] == pytest.approx(3.0, rel=1e-12)


def test_a_row_of_balls_passes_the_blow_on():
    """Three equal balls in a row: the last one leaves with all of the first one's speed."""
    balls = [
        {"name": n, "kind": "mass", "mass": 0.1, "displacement": x} for n, x in (("a", -1e-3), ("b", 0.0), ("c", 0.0))
    ]
    balls[0]["velocity"] = 1.0
    contacts = [
        {"body": "a", "on": "b", "stiffness": 1e9, "exponent": 1.5},
        {"body": "b", "on": "c", "gap": 2e-3, "stiffness": 1e9, "exponent": 1.5},
    ]
    rendering = engine.render(build(body=balls, contact=contacts, pickup=[{"body": "c"}]), seconds=0.03, trace=True)
    assert rendering.trace["velocity"][-1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_a_body_between_two_others():
    """A string between a hammer below and a rail above: both touch it, and the energy stays."""
    rail = {"body": "string", "at": [0.2, 0.5], "barrier": 2e-4, "stiffness": 1e8, "exponent": 1.5}
    rendering = engine.render(build(body=[STRING, HAMMER], contact=[FELT, rail], pickup=[EAR]), seconds=0.2, trace=True)
    assert np.all(rendering.trace["force"].max(axis=0) > 0.0)
    assert rendering.stats["energy"]["error_max"] <= 1e-12


def test_a_string_may_touch_itself_elsewhere():
    loop = {"body": "string", "at": 0.2, "on": "string", "on_at": 0.7, "gap": 1e-5, "stiffness": 1e6, "exponent": 1.5}
    rendering = engine.render(build(body=[STRING, HAMMER], contact=[FELT, loop], pickup=[EAR]), seconds=0.1, trace=True)
    assert rendering.trace["force"][:, 1].max() > 0.0
    assert rendering.stats["energy"]["error_max"] <= 1e-12


def test_hammer_on_string_is_of_order_two():
    """Error of the string's velocity after the hammer has left, against 32 times the rate."""

    def velocity(rate: int) -> float:
        return float(engine.render(hammered(), seconds=0.006 + 1 / rate, samplerate=rate).audio[round(0.006 * rate), 0])

    reference = velocity(24_000 * 32)
    steps = [1 / (24_000 * n) for n in (2, 4, 8)]
    errors = [velocity(24_000 * n) - reference for n in (2, 4, 8)]
    assert slope(steps, errors) == pytest.approx(2.0, abs=0.15)


def test_a_string_stays_on_a_constant_force():
    """Damped, it comes to rest where its compliance says: F·Σ Φ²/ω²."""
    body = STRING | {"sigma0": 60.0}
    force = [{"body": "string", "at": 0.3, "kind": "constant", "amplitude": 5.0}]
    pickup = [{"body": "string", "at": 0.3, "quantity": "displacement"}]
    rendering = engine.render(build(body=[body], force=force, pickup=pickup), seconds=1.0)
    modes = build(body=[body], pickup=pickup).body[0].modal_body(0.49 * 44_100)
    assert rendering.audio[-1, 0] == pytest.approx(5.0 * np.sum(modes.shape(0.3) ** 2 / modes.omega**2), rel=1e-12)


def reference_string(seconds: float, rate: int, gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Another method: an ideal string in explicit finite differences at 0.9 of the Courant limit, plucked as
    below, against a power law at its middle. Contact force, and velocity at x = 0.3."""
    length, density, frequency = 1.0, 2e-3, 110.0
    points = 10 * round(0.09 * rate / (2 * frequency))
    courant = 0.9
    step = courant / (2 * frequency * points)
    grid = length / points
    mass = density * grid
    y, before = np.zeros(points + 1), np.zeros(points + 1)
    at, middle, ear = round(0.2 * points), points // 2, round(0.3 * points)
    force, heard = np.zeros(round(seconds / step)), np.zeros(round(seconds / step))
    sigma = 2.0
    for n in range(force.size):
        following = np.zeros(points + 1)
        following[1:-1] = 2 * y[1:-1] - before[1:-1] + courant**2 * (y[2:] - 2 * y[1:-1] + y[:-2])
        t = n * step
        push = -4.0 * 0.5 * (1 - math.cos(math.pi * t / 0.004)) if t < 0.004 else 0.0
        following[at] += push * step**2 / mass
        force[n] = 1e6 * max(0.0, -gap - y[middle]) ** 1.5
        following[middle] += force[n] * step**2 / mass
        following[1:-1] = (following[1:-1] + sigma * step * before[1:-1]) / (1 + sigma * step)
        heard[n] = (following[ear] - before[ear]) / (2 * step)
        before, y = y, following
    return force, heard


@pytest.mark.hard
def test_string_against_an_obstacle_agrees_with_finite_differences():
    """First contact, its impulse, all impulses of 60 ms, and third-octave bands, against another method
    at 16 times the rate."""
    rate, gap, seconds = 44_100, 5e-4, 0.06
    body = {
        "name": "string",
        "kind": "string",
        "length": 1.0,
        "linear_density": 2e-3,
        "frequency": 110.0,
        "sigma0": 2.0,
    }
    contact = {"body": "string", "at": 0.5, "barrier": -gap, "side": "below", "stiffness": 1e6, "exponent": 1.5}
    pluck = {"body": "string", "at": 0.2, "kind": "pluck", "amplitude": -4.0, "duration": 0.004}
    scene = build(body=[body], contact=[contact], force=[pluck], pickup=[{"body": "string", "at": 0.3}])
    rendering = engine.render(scene, seconds=seconds, trace=True)
    ours, theirs = rendering.trace["force"][:, 0], None
    theirs, heard = reference_string(seconds, 16 * rate, gap)
    fine = len(theirs) / seconds

    def first(force: np.ndarray, rate: float) -> tuple[float, float]:
        """When the first episode of contact (with pauses below 1 ms) begins, and its impulse."""
        touched = np.flatnonzero(force > 0.0) / rate
        begin = touched[0]
        pauses = np.flatnonzero(np.diff(touched) > 1e-3)
        end = touched[pauses[0]] if pauses.size else touched[-1]
        return begin, force[round(begin * rate) : round(end * rate) + 1].sum() / rate

    assert first(ours, rate)[0] == pytest.approx(first(theirs, fine)[0], abs=1e-4)
    assert first(ours, rate)[1] == pytest.approx(first(theirs, fine)[1], rel=0.03)
    assert ours.sum() / rate == pytest.approx(theirs.sum() / fine, rel=0.03)

    def bands(x: np.ndarray, rate: float) -> np.ndarray:
        power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2 / rate**2
        frequency = np.fft.rfftfreq(x.size, 1 / rate)
        edges = 100.0 * 2 ** (np.arange(0, 15) / 3 - 1 / 6)
        return np.array([power[(frequency >= a) & (frequency < b)].sum() for a, b in pairwise(edges)])

    decibels = 10 * np.log10(bands(rendering.audio[:, 0], rate) / bands(heard, fine))
    assert np.abs(decibels).max() <= 1.0, decibels


# --- the score


def test_a_hammer_strikes_again():
    """A second blow with the first one's speed gives its energy again."""
    score = [{"kind": "strike", "time": 0.1, "body": "hammer", "velocity": 4.0}]
    rendering = engine.render(hammered(event=score), seconds=0.2, trace=True)
    struck = rendering.trace["force"][:, 0] > 0.0
    assert struck[:4410].any() and struck[4410:].any()
    supplied = rendering.trace["supplied"]
    before = 0.5 * HAMMER["mass"] * rendering.trace["velocity"][4410, 1] ** 2
    assert supplied[-1] == pytest.approx(0.5 * HAMMER["mass"] * 16.0 - before, rel=1e-12)
    assert rendering.stats["energy"]["error_max"] <= 1e-13


def test_a_pluck_of_the_score_is_a_force():
    pluck = {"kind": "pluck", "body": "string", "at": 0.3, "amplitude": 1.0, "duration": 0.002, "release": 1e-4}
    a = build(body=[STRING], force=[pluck | {"start": 0.01}], pickup=[EAR])
    b = build(body=[STRING], event=[pluck | {"time": 0.01}], pickup=[EAR])
    force, event = (engine.render(scene, seconds=0.1).audio for scene in (a, b))
    np.testing.assert_allclose(event, force, rtol=0, atol=1e-13 * np.abs(force).max())  # a table, and a formula


def test_damping_adds_its_decay_rate():
    """The envelope of a vibration falls with σ + σ_damp while it lasts, and with σ again after."""
    body = STRING | {"modes": 1, "sigma0": 3.0}
    score = [{"kind": "damp", "time": 0.5, "body": "string", "sigma": 40.0, "duration": 0.1}]
    pluck = {"kind": "pluck", "time": 0.0, "body": "string", "at": 0.5, "amplitude": 1.0, "duration": 0.001}
    scene = build(body=[body], event=[pluck, *score], pickup=[EAR])
    rendering = engine.render(scene, seconds=1.0, trace=True)
    total = rendering.trace["total"]
    for begin, end, rate in ((0.1, 0.5, 3.0), (0.5, 0.6, 43.0), (0.65, 0.95, 3.0)):
        a, b = total[round(begin * 44_100)], total[round(end * 44_100)]
        assert math.log(a / b) / 2 / (end - begin) == pytest.approx(rate, rel=0.02)


def test_a_barrier_moves_and_the_ledger_knows():
    """A stop pushed into a string lifts it; the work done is what it holds then."""
    rail = {"name": "rail", "body": "string", "at": [0.45, 0.5, 0.55], "barrier": -1e-3, "side": "below"}
    rail |= {"stiffness": 1e7, "exponent": 1.5}
    score = [{"kind": "change", "time": 0.01, "contact": "rail", "barrier": 1e-3, "duration": 0.05}]
    body = STRING | {"sigma0": 200.0}
    scene = build(body=[body], contact=[rail], event=score, pickup=[EAR | {"quantity": "displacement"}])
    rendering = engine.render(scene, seconds=0.2, trace=True)
    assert rendering.trace["compression"][0] == pytest.approx([-1e-3] * 3)
    assert rendering.audio[-1, 0] == pytest.approx(1e-3 * 0.37 / 0.45, rel=0.1)
    assert rendering.trace["supplied"][-1] > 0.9 * rendering.trace["total"][-1] > 0.0
    assert rendering.stats["energy"]["error_max"] <= 1e-12


def test_stiffness_glides_from_nothing():
    """A contact of no stiffness is there as soon as the score gives it some, and its glide is smooth."""
    rail = {
        "name": "rail",
        "body": "string",
        "at": 0.5,
        "barrier": -1e-4,
        "side": "below",
        "stiffness": 0.0,
        "exponent": 1.5,
    }
    score = [{"kind": "change", "time": 0.05, "contact": "rail", "stiffness": 1e7, "duration": 0.02}]
    rendering = engine.render(
        build(body=[STRING, HAMMER], contact=[FELT, rail], event=score, pickup=[EAR]), seconds=0.2, trace=True
    )
    force = rendering.trace["force"][:, 1]
    assert force[: round(0.05 * 44_100)].max() == 0.0
    assert force[round(0.07 * 44_100) :].max() > 0.0
    assert rendering.stats["energy"]["error_max"] <= 1e-12


@pytest.mark.parametrize("blocks", [[64], [1, 7, 300]])
def test_the_score_does_not_depend_on_blocks(blocks):
    from engine.assembly.build import build as built
    from engine.offline.simulation import Simulation

    score = [
        {"kind": "strike", "time": 0.0123, "body": "hammer", "velocity": 4.0},
        {"kind": "change", "time": 0.013, "contact": "felt", "stiffness": 1e8, "duration": 0.01},
        {"kind": "damp", "time": 0.02, "body": "string", "sigma": 5.0},
    ]
    scene = hammered(event=score)
    whole = engine.render(scene, seconds=0.1).audio
    model, state, _ = built(scene, 44_100)
    simulation, cut, begin, n = Simulation(model, state), np.zeros_like(whole), 0, 0
    while begin < len(cut):
        end = min(len(cut), begin + blocks[n % len(blocks)])
        simulation.render_block(cut[begin:end])
        begin, n = end, n + 1
    np.testing.assert_array_equal(cut, whole)


def test_cores_change_no_bit():
    """Eight strings on two cores: the samples of one core."""
    bodies, contacts = [], []
    for i in range(8):
        bodies += [STRING | {"name": f"s{i}"}, HAMMER | {"name": f"h{i}", "velocity": 2.0 + i / 4}]
        contacts.append(FELT | {"name": f"f{i}", "body": f"h{i}", "on": f"s{i}"})
    scene = build(body=bodies, contact=contacts, pickup=[EAR | {"body": f"s{i}"} for i in range(8)])
    one, two = (engine.render(scene, seconds=0.2, cores=n) for n in (1, 2))
    assert one.stats["cores"] == 1 and two.stats["cores"] == 2
    np.testing.assert_array_equal(one.audio, two.audio)
    assert one.stats["energy"]["error_max"] == two.stats["energy"]["error_max"] <= 1e-12


@pytest.mark.hard
@pytest.mark.parametrize("stiffness", [4.39e8, 1e10])
def test_a_lossless_tanpura_drifts_nowhere(stiffness):
    """Energy within 1e-11 over 600 000 steps on its bridge."""
    from bench.scenes.families import tanpuras

    scene = tanpuras(1, 30, stiffness=stiffness)
    bare = scene.body[0].model_copy(update={"sigma0": 0.0, "sigma_beta": 0.0, "sigma_beta3": 0.0})
    scene = scene.model_copy(update={"body": [bare]})
    rendering = engine.render(scene, seconds=600_000 / 44_100)
    assert rendering.stats["newton"]["unconverged"] == 0
    assert rendering.stats["energy"]["error_max"] <= 1e-11


def test_too_many_points_of_contact_are_refused():
    from engine.faults import BuildError

    rail = {"body": "string", "at": [i / 300 for i in range(1, 257)], "barrier": -1e-3, "side": "below"}
    rails = [rail | {"stiffness": 1e7, "exponent": 1.5, "name": f"rail{i}"} for i in range(3)]
    with pytest.raises(BuildError, match="769 contact points join string, hammer; an island may have 512"):
        engine.render(build(body=[STRING, HAMMER], contact=[FELT, *rails], pickup=[EAR]))
