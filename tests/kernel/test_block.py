"""The sample loop: any block size gives the same samples, and absent effects are absent."""

import numpy as np
import pytest
from conftest import PATCHES, mostly_hard

import engine
from bench.scenes.small import barrier, mass, oscillator, scene
from engine.assembly.build import build
from engine.kernel.data import effects
from engine.kernel.data.axes import arrays_of
from engine.offline.simulation import Simulation


def run(scene: engine.Scene, frames: int, sizes: list[int]) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Render in blocks of the given sizes, over and over."""
    model, state, _ = build(scene, 44_100)
    out = np.empty((frames, scene.channels))
    simulation = Simulation(model, state)
    begin, n = 0, 0
    while begin < frames:
        end = min(frames, begin + sizes[n % len(sizes)])
        simulation.render_block(out[begin:end])
        begin, n = end, n + 1
    return out, simulation.energies(), list(arrays_of(state))


@pytest.mark.hard_but("bouncing_ball", "buzzing_reed", "piano_c4", "bass_frets", "slack_bass", "rattle")
@pytest.mark.parametrize("path", PATCHES, ids=lambda p: p.stem)
def test_block_size_changes_no_bit(path):
    scene = engine.load(path)
    whole, energies, state = run(scene, 20_000, [20_000])
    sizes = np.random.default_rng(1).integers(1, 1024, 50).tolist()
    for blocks in ([64], [1, 7, 300], sizes):
        cut, cut_energies, cut_state = run(scene, 20_000, blocks)
        np.testing.assert_array_equal(cut, whole)
        assert cut_energies == energies
        for a, b in zip(cut_state, state, strict=True):
            np.testing.assert_array_equal(a, b)


def test_rendering_twice_gives_the_same(patch):
    scene = patch("marble_on_a_bell")
    np.testing.assert_array_equal(engine.render(scene, seconds=0.5).audio, engine.render(scene, seconds=0.5).audio)


def test_measuring_changes_nothing(patch):
    """Neither the ledger nor a trace touches the scheme."""
    scene = patch("marble_on_a_bell")
    model, state, _ = build(scene, 44_100)
    bare = np.empty((8820, 1))
    Simulation(model, state, measure_energy=False).render_block(bare)
    rendering = engine.render(scene, seconds=0.2, trace=True)
    np.testing.assert_array_equal(rendering.audio, bare)
    np.testing.assert_array_equal(rendering.audio, engine.render(scene, seconds=0.2).audio)
    bell = rendering.trace["velocity"][:, 1]  # in free flight traced by single steps, heard by tables of many
    np.testing.assert_allclose(rendering.audio[:, 0], bell, rtol=0.0, atol=1e-14 * np.abs(bell).max())


def test_what_amounts_to_nothing_is_no_effect(patch):
    """Neither what a patch does not name nor what has no strength."""
    body = oscillator(frequency=100.0, damping_rate=0.0, displacement=1.0)
    model = build(scene([body], gravity=0.0), 44_100).model
    assert model.effects == effects.SPRINGS and model.refinement is None
    nothing = build(
        scene(
            [mass(damping_rate=0.0)],
            contact=[barrier(stiffness=0.0, loss=1.0)],
            force=[{"body": "body", "kind": "constant", "amplitude": 0.0}],
        ),
        44_100,
    ).model
    assert nothing.effects == 0
    everything = build(patch("buzzing_reed"), 44_100).model.effects
    assert everything & effects.SEVERAL and everything & effects.CONTACT_LOSS


def test_islands_do_not_hear_each_other(patch):
    """Six hammers and bars together sound as each pair alone."""
    scene = patch("felt_arpeggio")
    assert build(scene, 44_100).model.islands.mode.size - 1 == 6
    rendering = engine.render(scene, seconds=1.0)
    alone = []
    for contact, pickup in zip(scene.contact, scene.pickup, strict=True):
        pair = [b for b in scene.body if b.name in (contact.body, contact.on)]
        part = scene.model_copy(update={"body": pair, "contact": [contact], "pickup": [pickup]})
        alone.append(engine.render(part, seconds=1.0).audio)
    left, right = sum(a[:, 0] for a in alone[::2]), sum(a[:, -1] for a in alone[1::2])
    np.testing.assert_allclose(rendering.audio, np.stack([left, right], 1), rtol=0, atol=1e-15)


@pytest.mark.parametrize("alpha", mostly_hard([1.0, 1.5, 2.0, 3.3]))
def test_several_contacts_on_one_body(alpha):
    """Two equal barriers at one place push as one of twice the stiffness."""
    body = [oscillator(frequency=5.0, velocity=1.0, displacement=-1e-3)]
    far = barrier(barrier=1.0, exponent=2.3)  # a third contact, never reached: all is solved as coupled
    two = scene(body, contact=[barrier(exponent=alpha), barrier(exponent=alpha), far])
    one = scene(body, contact=[barrier(exponent=alpha, stiffness=2e8), far])
    a, b = (engine.render(s, seconds=0.02, trace=True) for s in (two, one))
    np.testing.assert_allclose(a.trace["displacement"], b.trace["displacement"], rtol=0, atol=1e-13)
    np.testing.assert_allclose(a.trace["force"].sum(1), b.trace["force"][:, 0], rtol=0, atol=1e-7)
    assert a.trace["force"].max() > 50
    assert a.stats["energy"]["error_max"] < 1e-13


def test_a_body_squeezed_between_two_barriers():
    """Overlapping stops press on the body from both sides at once; energy is kept."""
    body = [oscillator(frequency=200.0, velocity=0.05)]
    contact = [barrier(barrier=-1e-4, exponent=1.5), barrier(barrier=1e-4, side="below", exponent=2.3)]
    rendering = engine.render(scene(body, contact=contact), seconds=0.5, trace=True)
    assert np.all(rendering.trace["force"][1:] >= 0)
    assert np.mean((rendering.trace["force"] > 0).all(axis=1)) > 0.2
    assert rendering.stats["energy"]["error_max"] < 1e-12
    assert rendering.stats["newton"]["unconverged"] == 0


def test_pickups_hear_what_they_say(patch):
    """Displacement, velocity, acceleration and force of one body, on four channels."""
    names = ["displacement", "velocity", "acceleration", "force"]
    pickup = [{"body": "ball", "quantity": q, "channel": i + 1, "gain": 2.0} for i, q in enumerate(names)]
    dump = patch("bouncing_ball").model_dump(exclude_none=True) | {"pickup": pickup}
    rendering = engine.render(engine.Scene.model_validate(dump), seconds=0.5, trace=True)
    audio, trace = rendering.audio / 2, rendering.trace
    np.testing.assert_allclose(audio[:, 0], trace["displacement"][:, 0], atol=1e-14)
    np.testing.assert_allclose(audio[:, 1], trace["velocity"][:, 0], atol=1e-13)
    np.testing.assert_allclose(audio[1:, 2], np.diff(trace["velocity"][:, 0]) * 44_100, atol=1e-9)
    np.testing.assert_array_equal(audio[:, 3], trace["force"][:, 0])
    # m·a = contact force - m·g, where the ball touches the floor
    np.testing.assert_allclose(audio[1:, 2], audio[1:, 3] - 9.81, atol=1e-8)
