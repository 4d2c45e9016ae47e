"""The dial between error and time: what a finer setting promises."""

import tomllib

import numpy as np
import pytest
from conftest import ROOT, slope

import engine
from bench.scenes.small import barrier, mass, oscillator, scene
from bench.scenes.struck import random_collision
from engine.assembly.build import build
from engine.offline.simulation import Simulation
from engine.patch.accuracy import Accuracy

REPELLED = ROOT / "patches" / "repelled_oscillator.toml"


def audio(scene: engine.Scene, seconds: float, **accuracy) -> np.ndarray:
    rendering = engine.render(scene, seconds=seconds, cores=1, silence=-np.inf, iterations=100, **accuracy)
    assert rendering.stats["newton"]["unconverged"] == 0
    assert rendering.stats["energy"]["error_max"] <= 1e-12
    return rendering.audio


def hammer(**more) -> engine.Scene:
    """A felt hammer on a string, thrown twice."""
    bodies = [
        {"name": "string", "kind": "string", "length": 0.62, "mass": 4e-3, "tension": 670.0, "modes": 40},
        {"name": "hammer", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 4.0},
    ]
    bodies[0]["sigma0"] = 0.5
    felt = {"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5}
    again = {"kind": "strike", "time": 0.06, "body": "hammer", "displacement": -1e-3, "velocity": 3.0}
    told = {"body": bodies, "contact": [felt], "event": [again], "pickup": [{"body": "string", "at": 0.4}]}
    return engine.Scene.model_validate(told | more)


@pytest.mark.parametrize(("order", "wanted", "counts"), [(2, 2.0, [8, 16, 32]), (4, 4.0, [1, 2, 4]), (6, 6.0, [1, 2])])
def test_the_order_of_a_step(order, wanted, counts):
    """ORACLES 8: the error falls with the step to the order, where α ≥ 2. An oscillator on an α = 2 barrier."""
    told = engine.load(REPELLED).model_copy(
        update={"contact": [c.model_copy(update={"exponent": 3.0}) for c in engine.load(REPELLED).contact]}
    )
    reference = audio(told, 0.02, order=6, substeps=12)
    errors = [np.abs(audio(told, 0.02, order=order, substeps=n) - reference).max() for n in counts]
    assert -slope(counts, errors) == pytest.approx(wanted, abs=0.35)


def test_order_four_buys_three_digits_for_little():
    """docs/design.md, sec. 2: where a hammer touches for a few ms, order 4 with 4 substeps errs by less than 1e-5."""
    told = hammer()
    reference = audio(told, 0.05, order=4, substeps=32)
    size = np.sqrt(np.mean(reference**2))
    plain, fine = (np.sqrt(np.mean((audio(told, 0.05, order=o, substeps=n) - reference) ** 2)) / size
                   for o, n in ((2, 1), (4, 4)))  # fmt: skip
    assert 1e-3 < plain < 1e-1
    assert fine < 1e-5


def test_free_flight_is_not_refined():
    """Out of contact a sample is one step, and is the same."""
    told = hammer()
    plain, fine = (engine.render(told, seconds=0.05, **more) for more in ({}, {"order": 4, "substeps": 4}))
    off = int(np.argmax(plain.audio != 0.0))  # the hammer has arrived
    assert off > 5
    np.testing.assert_array_equal(fine.audio[:off], plain.audio[:off])
    assert fine.stats["activity"]["contact"] == pytest.approx(plain.stats["activity"]["contact"], rel=0.1)


@pytest.mark.parametrize(
    "told",
    [
        hammer(),
        pytest.param(
            scene(
                [oscillator(frequency=3000.0, displacement=-1e-3, velocity=5.0, damping_rate=100.0)],
                contact=[barrier(barrier=2e-4, stiffness=1e7)],
                gravity=9.81,
            ),
            marks=pytest.mark.hard,
        ),
    ],
    ids=["hammer", "fast oscillator"],
)
def test_no_contact_is_overlooked(told):
    """Refining only where contact is possible gives what refining always gives."""
    found = []
    for always in (False, True):
        model, state, _ = build(told, 44_100, Accuracy(order=4, substeps=2))
        model = model._replace(refinement=model.refinement._replace(refine_free_flight=always))
        out = np.zeros((4410, 1))
        Simulation(model, state).render_block(out)
        assert state.contact_samples[0] > 10
        found.append(out)
    assert np.abs(found[0] - found[1]).max() <= 1e-10 * np.abs(found[1]).max()


EVERYTHING = {
    "gravity": 9.81,
    "body": [
        oscillator(name="a", frequency=300.0, damping_rate=5.0, velocity=1.0),
        oscillator(name="b", frequency=170.0, damping_rate=1.0, displacement=1e-4),
        mass(name="c", mass=0.02, displacement=5e-4, velocity=-1.0),
    ],
    "contact": [
        {"body": "a", "on": "b", "stiffness": 1e7, "exponent": 1.5},
        {"body": "a", "barrier": 1e-4, "stiffness": 1e8, "exponent": 2.3},
        {"name": "floor", "body": "c", "on": "b", "side": "below", "stiffness": 1e6, "exponent": 1.0},
    ],
    "force": [{"kind": "half_sine", "body": "a", "amplitude": 30.0, "duration": 0.02}],
    "event": [
        {"kind": "strike", "time": 0.1, "body": "c", "velocity": -2.0},
        {"kind": "change", "time": 0.12, "contact": "floor", "stiffness": 1e8, "duration": 0.05},
    ],
    "pickup": [{"body": "a"}, {"body": "b", "quantity": "force", "channel": 2}],
}


@pytest.mark.hard
@pytest.mark.parametrize("loss", [0.0, 0.02, 0.5])
@pytest.mark.parametrize("accuracy", [{"order": 4}, {"order": 6, "substeps": 2}, {"order": 2, "substeps": 3}], ids=str)
def test_the_ledger_closes_at_every_setting(accuracy, loss):
    told = engine.Scene.model_validate(EVERYTHING)
    lossy = [c.model_copy(update={"loss": loss}) for c in told.contact]
    told = told.model_copy(update={"contact": lossy})
    stats = engine.render(told, seconds=0.4, **accuracy).stats
    assert "refinement" in stats["effects"]["compiled"]
    assert stats["newton"]["unconverged"] == 0
    assert stats["activity"]["contact"] > 0.1
    assert stats["energy"]["error_max"] <= 1e-12


def test_a_refined_sample_does_not_depend_on_blocks():
    told = hammer()
    whole = engine.render(told, seconds=0.1, order=4, substeps=2, cores=1).audio
    for size in (64, 37, 1):
        model, state, _ = build(told, 44_100, Accuracy(order=4, substeps=2))
        cut, simulation = np.zeros_like(whole), Simulation(model, state)
        for begin in range(0, len(cut), size):
            simulation.render_block(cut[begin : begin + size])
        np.testing.assert_array_equal(cut, whole)


@pytest.mark.hard
def test_the_force_of_a_refined_sample_is_its_mean():
    """m·Δv = force·h, also over stages that go back in time."""
    told = scene([mass(mass=0.01, displacement=-1e-3, velocity=2.0)], contact=[barrier(stiffness=1e7)])
    trace = engine.render(told, seconds=0.01, order=4, trace=True).trace
    np.testing.assert_allclose(
        trace["force"][1:, 0], -0.01 * np.diff(trace["velocity"][:, 0]) * 44_100, rtol=1e-9, atol=1e-9
    )
    assert trace["force"].max() > 1.0


LOSSY_HAMMER = """
seconds = 0.02
[[body]]
name = "string"
kind = "string"
length = 0.62
mass = 3.93e-3
tension = 670.0
modes = {modes}
residual = false
[[body]]
name = "hammer"
kind = "mass"
mass = {mass}
displacement = -1e-4
velocity = {velocity}
[[contact]]
body = "hammer"
on = "string"
on_at = {at}
stiffness = {stiffness}
exponent = {exponent}
loss = {loss}
[[contact]]
body = "string"
at = 0.4
barrier = 1e-4
stiffness = {stiffness}
exponent = {exponent}
loss = {loss}
[[pickup]]
body = "string"
at = 0.3
"""


@pytest.mark.hard
@pytest.mark.parametrize("order", [4, 6])
def test_contact_loss_apart_from_the_solve_never_pulls_and_never_gives(order):
    """Over decades of stiffness, loss and speed: the whole force, elastic and lossy, pushes, and what is dissipated
    only grows."""
    draw = np.random.default_rng(order)
    for _ in range(30):
        exponent = draw.uniform(1.0, 4.0)
        parts = {
            "mass": 10 ** draw.uniform(-4, -1),
            "velocity": 10 ** draw.uniform(-1, 1),
            "at": draw.uniform(0.05, 0.95),
        }
        parts |= {"stiffness": 10 ** (draw.uniform(3, 9) + 3 * (exponent - 1)), "loss": 10 ** draw.uniform(-3, 1.5)}
        text = LOSSY_HAMMER.format(modes=int(draw.integers(5, 60)), exponent=exponent, **parts)
        rendering = engine.render(engine.Scene.model_validate(tomllib.loads(text)), order=order, trace=True)
        force, energy = rendering.trace["force"], rendering.stats["energy"]
        assert force.min() >= -1e-12 * force.max(), text
        assert np.diff(rendering.trace["dissipated"]).min() >= -1e-16 * energy["initial"], text
        assert energy["error_max"] <= 1e-12, text


@pytest.mark.parametrize(("seed", "loss", "order"), [(51, 3.0, 4), (363, 3.0, 6), (375, 0.3, 4), (583, 3.0, 4)])
def test_contact_loss_apart_does_not_pull_where_a_string_touches_a_fret_within_one_sample(seed, loss, order):
    """At the start of that sample nothing tells that bodies will part in it."""
    told = random_collision(seed)
    lossy = [c.model_copy(update={"loss": loss}) for c in told.contact]
    rendering = engine.render(told.model_copy(update={"contact": lossy}), seconds=0.05, order=order, trace=True)
    assert rendering.trace["force"].min() >= -1e-12 * rendering.trace["force"].max()
    assert rendering.stats["energy"]["error_max"] <= 1e-12


@pytest.mark.parametrize("places", [(0.3, 0.31), (0.3, 0.7)])
def test_the_ledger_closes_where_a_string_touches_itself_with_loss(places):
    """Both places of such a contact weigh the same modes."""
    shape = {"kind": "triangle", "at": 0.2, "amplitude": 2e-3}
    string = {"name": "s", "kind": "string", "length": 0.62, "mass": 4e-3, "frequency": 200.0, "modes": 30}
    touch = {"body": "s", "at": places[0], "on": "s", "on_at": places[1], "gap": -1e-5}
    touch |= {"stiffness": 1e6, "exponent": 1.5, "loss": 0.1}
    told = scene([string | {"displacement": shape}], contact=[touch], pickup=[{"body": "s", "at": 0.4}])
    stats = engine.render(told, seconds=0.05, order=4).stats
    assert stats["activity"]["contact"] > 0.1
    assert stats["energy"]["error_max"] <= 1e-12


def test_order_four_says_where_strong_contact_loss_made_it_order_two():
    body, gap = [mass(mass=0.01, velocity=1.0, displacement=-1e-4)], {"stiffness": 1e5, "exponent": 1.0}
    weak = engine.render(scene(body, contact=[barrier(loss=0.1, **gap)]), seconds=0.01, order=4)
    assert weak.stats["warnings"] == []
    strong = engine.render(scene(body, contact=[barrier(loss=1e3, **gap)]), seconds=0.01, order=4)
    (message,) = strong.stats["warnings"]
    assert message.startswith("order 4 was reduced to order 2 in ") and "contact damping is too strong" in message


def test_oversampling_is_closer_too():
    told = hammer()
    reference = audio(told, 0.05, order=4, substeps=32)
    plain, fine = (np.abs(audio(told, 0.05, oversample=n)[100:2000] - reference[100:2000]).max() for n in (1, 8))
    assert fine < plain / 5


def test_the_energy_of_a_hammer_is_exact_at_order_four():
    assert engine.render(hammer(), seconds=0.1, order=4).stats["energy"]["error_max"] <= 1e-13


def test_the_patch_says_how_exactly_and_an_argument_outweighs_it():
    told = hammer(accuracy={"order": 4, "substeps": 2})
    said = engine.render(told, seconds=0.02)
    assert said.stats["accuracy"]["order"] == 4
    np.testing.assert_array_equal(said.audio, engine.render(hammer(), seconds=0.02, order=4, substeps=2).audio)
    assert engine.render(told, seconds=0.02, order=2).stats["accuracy"]["order"] == 2
    with pytest.raises(ValueError, match="order = 3 is out of range"):
        engine.render(told, seconds=0.02, order=3)


@pytest.mark.parametrize("oversample", [2, 3, 5, 7, 8, 32])
def test_oversampling_is_right_to_the_last_sample(oversample):
    """A free oscillator keeps its sine to 1e-9 at any factor, from a few milliseconds after its start to the end."""
    tone = scene([oscillator(frequency=3000.0, velocity=1.0)], seconds=0.05)
    audio = engine.render(tone, oversample=oversample).audio[:, 0]
    wanted = np.cos(2 * np.pi * 3000.0 * np.arange(len(audio)) / 44_100)
    assert len(audio) == 2205
    assert np.max(np.abs(audio - wanted)[200:]) <= 1e-9
