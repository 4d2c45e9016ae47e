"""Contacts that last only a few steps: they are named, with how long they last, and what is said to resolve them
does."""

import itertools
import math

import numpy as np
import pytest
import scipy

import engine
from engine.offline import brief_contacts, render
from engine.offline.brief_contacts import touch_durations

CHAIN = np.array([-0.1419, 0.1528, 1.9891])  # m/s: DOP853 at 1e-12, for any stiffness
SETTINGS = [{}, {"substeps": 4}, {"order": 4}, {"order": 4, "substeps": 3}, {"order": 6}, {"max_error": 1e-2}]
RESOLVED, UNRESOLVED = 0.045, 0.01  # of the speed: how far balls are off that are not named, and that are


def three_balls(stiffness: float, loss: float = 0.0) -> engine.Scene:
    """A ball that hits two others, which touch."""
    balls = [{"name": n, "kind": "mass", "mass": 1.0, "velocity": 2.0 if n == "a" else 0.0} for n in "abc"]
    law = {"stiffness": stiffness, "exponent": 1.5, "loss": loss}
    contacts = [{"body": "a", "on": "b", "gap": 0.01, **law}, {"body": "b", "on": "c", "name": "second", **law}]
    return engine.load({"body": balls, "contact": contacts, "pickup": [{"body": "c"}]})


def dropped_ball(stiffness: float, exponent: float, loss: float, height: float = 2.0) -> engine.Scene:
    """A ball of 1 kg above a floor."""
    ball = {"name": "ball", "kind": "mass", "mass": 1.0, "displacement": height}
    floor = {"body": "ball", "side": "below", "barrier": 0.0, "stiffness": stiffness, "exponent": exponent}
    tables = {"body": [ball], "contact": [floor | {"loss": loss}], "pickup": [{"body": "ball"}]}
    return engine.load(tables | {"gravity": 9.81})


def loss_for(restitution: float, speed: float) -> float:
    """The loss μ, s/m, of a contact with a restitution: u/μ - ln(1 + μu)/μ² is the same before and after it."""

    def change(loss: float) -> float:
        before, after = (u / loss - math.log1p(loss * u) / loss**2 for u in (speed, -restitution * speed))
        return before - after

    return float(scipy.optimize.brentq(change, 1e-6, (1 - 1e-12) / (restitution * speed)))


def squared_restitution(rendering: engine.Rendering) -> float:
    """Energy of a ball after its first touch over that before."""
    velocity, force = rendering.trace["velocity"][:, 0], rendering.trace["force"][:, 0]
    first = int(np.flatnonzero(force)[0])
    last = first + int(np.flatnonzero(force[first:] == 0.0)[0]) - 1
    return float((velocity[last] / velocity[first - 1]) ** 2)


def remedy_of(rendering: engine.Rendering, settings: dict) -> dict:
    """The settings that a rendering says would resolve its contacts."""
    return settings | {"substeps": max(contact.substeps for contact in rendering.stats.brief_contacts)}


@pytest.mark.parametrize(("stiffness", "settings"), [*itertools.product([1e8, 1e10, 1e11, 1e12, 1e14], SETTINGS)])
def test_balls_that_share_momentum_wrongly_are_named_and_no_others(stiffness, settings):
    told = three_balls(stiffness)
    rendering = engine.render(told, seconds=0.02, trace=True, cores=1, **settings)
    error = np.abs(rendering.trace["velocity"][-1] - CHAIN).max() / 2.0
    named = [contact.contact for contact in rendering.stats.brief_contacts]
    assert named in ([], ["contact.0", "second"])
    assert (error > UNRESOLVED) if named else (error < RESOLVED)
    if named:
        mended = engine.render(told, seconds=0.02, trace=True, cores=1, **remedy_of(rendering, settings))
        assert mended.stats.brief_contacts == []
        assert np.abs(mended.trace["velocity"][-1] - CHAIN).max() / 2.0 < UNRESOLVED


def test_the_warning_names_contacts_and_bodies_and_what_resolves_them():
    (line,) = engine.render(three_balls(1e12), seconds=0.02).stats.warnings
    assert 'contact.0 ("a" on "b") lasts 1.4 steps (0.032 ms)' in line
    assert 'second ("b" on "c") lasts 1.5 steps (0.034 ms)' in line
    assert line.endswith("give substeps = 8, or max_error")
    (line,) = engine.render(three_balls(1e14), seconds=0.02, max_error=1e-2, max_substeps=4).stats.warnings[-1:]
    assert "give max_substeps = " in line


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
@pytest.mark.parametrize("restitution", [0.3, 0.8, 0.95])
@pytest.mark.parametrize(("stiffness", "exponent"), [(1e7, 1.5), (1e9, 1.5), (1e9, 1.0), (1e12, 2.0)])
def test_a_ball_that_loses_the_wrong_energy_is_named(stiffness, exponent, restitution, settings):
    speed = math.sqrt(2 * 9.81 * 2.0)
    told = dropped_ball(stiffness, exponent, loss_for(restitution, speed))
    rendering = engine.render(told, seconds=0.66, samplerate=4000, trace=True, cores=1, **settings)
    if rendering.stats.brief_contacts:
        mended = remedy_of(rendering, settings)
        rendering = engine.render(told, seconds=0.66, samplerate=4000, trace=True, cores=1, **mended)
    assert rendering.stats.brief_contacts == []
    assert squared_restitution(rendering) == pytest.approx(restitution**2, rel=0.035)


@pytest.mark.parametrize("restitution", [0.3, 0.8, 1.0])
def test_a_ball_on_a_hard_floor_at_4_khz_is_named(restitution):
    loss = loss_for(restitution, math.sqrt(2 * 9.81 * 2.0)) if restitution < 1.0 else 0.0
    rendering = engine.render(dropped_ball(1e9, 1.5, loss), seconds=0.66, samplerate=4000)
    (contact,) = rendering.stats.brief_contacts
    assert (contact.bodies, contact.touches) == (["ball"], 1)
    assert contact.steps == pytest.approx(2.24, rel=0.1)


@pytest.mark.parametrize("settings", [{}, {"substeps": 2}, {"order": 4}, {"order": 6}, {"oversample": 2}], ids=str)
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.3, 3.0])
def test_durations_are_the_true_ones(exponent, settings):
    """Of a contact with a barrier, and of one between bodies, where one is an oscillator; against fine steps."""
    balls = [{"name": "a", "kind": "mass", "mass": 0.02, "velocity": 3.0}]
    balls += [{"name": "b", "kind": "oscillator", "mass": 0.05, "frequency": 300.0, "damping_rate": 1.0}]
    stiffness = 1.6e7 * 4e4 ** (exponent - 1)
    contact = {"body": "a", "on": "b", "gap": 0.001, "stiffness": stiffness, "exponent": exponent}
    told = engine.load({"body": balls, "contact": [contact], "pickup": [{"body": "b"}]})
    (found,) = engine.render(told, seconds=0.004, samplerate=4000, **settings).stats.brief_contacts
    fine = engine.render(told, seconds=0.004, samplerate=4000 * 128, trace=True)
    assert found.duration == pytest.approx(fine.contacts["contact.0"].first_duration, rel=0.03)
    finest = 4000 * settings.get("substeps", 1) * settings.get("oversample", 1)
    assert found.steps == pytest.approx(found.duration * finest)


def test_a_linear_spring_touches_for_half_a_period():
    np.testing.assert_allclose(touch_durations(0.3, 2e5, 1.0, np.array([0.1, 7.0])), math.pi * math.sqrt(0.3 / 2e5))


def test_touches_are_counted_across_blocks():
    told = dropped_ball(1e9, 1.0, 0.0, height=1e-4)
    rendering = engine.render(told, seconds=1.5, samplerate=8000, trace=True)
    (contact,) = rendering.stats.brief_contacts
    assert contact.touches == rendering.contacts["contact.0"].touches > 100


@pytest.mark.hard_for("1", "7")
@pytest.mark.parametrize("frames", [1, 7, 64])
def test_they_are_the_same_in_blocks_of_any_size(frames, monkeypatch):
    told = engine.load("snare_wires")
    whole = engine.render(told, seconds=0.05).stats.brief_contacts
    monkeypatch.setattr(render, "FIRST_CHUNK_FRAMES", frames)
    monkeypatch.setattr(render, "MAX_CHUNK_FRAMES", frames)
    assert engine.render(told, seconds=0.05).stats.brief_contacts == whole != []


@pytest.mark.parametrize(
    "patch", ["piano_c4", "bouncing_ball", "lossy_bounce", "marimba", "marble_on_a_bell", "vibraphone"]
)
def test_contacts_of_shipped_patches_that_are_resolved_are_not_named(patch):
    assert engine.render(engine.load(patch), seconds=0.1).stats.brief_contacts == []


@pytest.mark.hard_for("sitar-C4_jawari")
@pytest.mark.parametrize(("patch", "name"), [("rattle", "knock"), ("sitar", "C4_jawari"), ("buzzing_reed", "brass")])
def test_contacts_of_shipped_patches_that_are_brief_are_named(patch, name):
    named = engine.render(engine.load(patch), seconds=0.5).stats.brief_contacts
    assert name in [contact.contact for contact in named]


@pytest.mark.hard_for("snare_wires-{'substeps': 2}", "snare_wires-{'oversample': 2}")
@pytest.mark.parametrize("settings", [{}, {"substeps": 2}, {"oversample": 2}], ids=str)
@pytest.mark.parametrize("patch", ["rattle", "snare_wires", "tanpura", "bass_frets"])
def test_samples_are_the_same_whether_contacts_are_watched_or_not(patch, settings, monkeypatch):
    told = engine.load(patch)
    watched = engine.render(told, seconds=0.15, trace=True, **settings)
    monkeypatch.setattr(brief_contacts, "find_contacts", lambda *_: [])
    plain = engine.render(told, seconds=0.15, trace=True, **settings)
    assert np.array_equal(watched.audio, plain.audio)
    assert np.array_equal(watched.trace["force"], plain.trace["force"])
    assert watched.stats.energy == plain.stats.energy and watched.stats.channels == plain.stats.channels
    assert plain.stats.brief_contacts == []


@pytest.mark.parametrize(
    "change",
    [
        {"contact": "floor", "stiffness": 1e13},
        {"contact": "floor", "exponent": 1.0, "stiffness": 1e10},
        {"parameter": "contact.floor.stiffness", "value": 1e13},
    ],
    ids=str,
)
def test_a_contact_that_an_event_makes_hard_is_named(change):
    tables = dropped_ball(1e5, 1.5, 0.0, height=0.05).model_dump(exclude_none=True, exclude_unset=True)
    tables["contact"][0]["name"] = "floor"
    assert engine.render(engine.load(tables), seconds=0.3).stats.brief_contacts == []
    tables["event"] = [{"kind": "change", "time": 0.15, **change}]
    hard = engine.render(engine.load(tables), seconds=0.4)
    assert [contact.contact for contact in hard.stats.brief_contacts] == ["floor"]


@pytest.mark.hard
def test_shapes_are_traced_beside_the_watched_contacts():
    told = engine.load("rattle")
    shaped = engine.render(told, seconds=0.1, trace_shapes=True)
    plain = engine.render(told, seconds=0.1)
    assert np.array_equal(shaped.audio, plain.audio) and shaped.trace["shape.string"].any()
    assert shaped.stats.brief_contacts == plain.stats.brief_contacts != []


@pytest.mark.hard
def test_tables_that_the_score_changes_leave_the_watched_contacts_apart(monkeypatch):
    """A pickup of a watched contact hears that contact alone, also after tables were exchanged."""
    tables = engine.load("rattle").model_dump(exclude_none=True, exclude_unset=True)
    change = {"kind": "change", "time": 0.1, "parameter": "body.string.frequency", "value": 140.0, "duration": 0.05}
    told = engine.load(tables | {"event": [*tables.get("event", []), change]})
    watched = engine.render(told, seconds=0.3, trace=True)
    (contact,) = watched.stats.brief_contacts
    assert contact.contact == "knock" and contact.touches <= watched.contacts["knock"].touches
    monkeypatch.setattr(brief_contacts, "find_contacts", lambda *_: [])
    plain = engine.render(told, seconds=0.3, trace=True)
    assert np.array_equal(watched.audio, plain.audio)
