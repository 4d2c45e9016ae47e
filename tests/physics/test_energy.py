"""Stored + dissipated - supplied = constant, whatever collides."""

import math

import numpy as np
import pytest
from conftest import PATCHES

import engine

LOSSLESS = ["barrier_linear", "barrier_quadratic", "barrier_cubic", "bouncing_ball", "repelled_oscillator"]


@pytest.mark.parametrize("scheme", ["exact", "fdh"])
@pytest.mark.parametrize("name", LOSSLESS)
def test_lossless_patches_keep_their_energy(patch, name, scheme):
    """To rounding, over the durations of the paper's figures."""
    rendering = engine.render(patch(name), scheme=scheme, trace=True)
    energy = rendering.stats["energy"]
    assert energy["error_per_step_max"] <= 2e-15
    assert energy["error_max"] <= 1e-13
    assert energy["dissipated"] == energy["supplied"] == 0.0
    # the same from the trace, without the audit
    total = rendering.trace["total"]
    assert np.max(np.abs(total - total[0])) <= 1e-13 * total.max()
    assert rendering.trace["contact"].max() > 0.01 * total.max(), "there was no collision to speak of"


@pytest.mark.hard
@pytest.mark.parametrize("scheme", ["exact", "fdh"])
def test_a_minute_of_collisions_keeps_its_energy(patch, scheme):
    """26 000 collisions of Fig. 6."""
    rendering = engine.render(patch("repelled_oscillator"), seconds=60, scheme=scheme)
    assert rendering.stats["energy"]["error_max"] <= 1e-12
    assert rendering.stats["newton"]["regimes"]["separation"] > 26_000


@pytest.mark.hard_but(
    "bouncing_ball-exact",
    "bouncing_ball-fdh",
    "lossy_bounce-exact",
    "piano_c4-exact",
    "piano_c4-fdh",
    "rattle-fdh",
    "bass_frets-fdh",
    "buzzing_reed-exact",
    "grand_c7-exact",
)
@pytest.mark.parametrize("scheme", ["exact", "fdh"])
@pytest.mark.parametrize("path", PATCHES, ids=lambda p: p.stem)
def test_the_ledger_closes(path, scheme):
    """With everything on."""
    scene = engine.load(path)
    rendering = engine.render(scene, scheme=scheme, seconds=min(3.0, scene.seconds))
    assert rendering.stats["energy"]["error_max"] <= 1e-12
    assert rendering.stats["newton"]["reversed_steps"] == 0


@pytest.mark.hard_for("tanpura")
@pytest.mark.parametrize("name", ["driven_ball", "lossy_bounce", "marble_on_a_bell", "buzzing_reed", "tanpura"])
def test_energy_never_rises_while_none_is_supplied(patch, name):
    """Sample by sample, from the trace."""
    rendering = engine.render(patch(name), seconds=2.0, trace=True)
    trace, stats = rendering.trace, rendering.stats["energy"]
    balance = trace["total"] + trace["dissipated"] - trace["supplied"]
    largest = np.max(np.abs(trace["total"]))
    assert np.max(np.abs(balance - balance[0])) <= 1e-12 * largest
    assert stats["error_max"] <= 1e-12
    rise = np.diff(trace["total"])[np.diff(trace["supplied"]) == 0.0]
    assert rise.size > 0
    assert rise.max() <= 2e-15 * largest
    assert np.diff(trace["dissipated"]).min() >= 0.0


@pytest.mark.parametrize("name", ["piano_c4", "ball_on_drum", "marble_on_a_bell"])
@pytest.mark.parametrize("seconds", [0.3, 0.31234, 1 / 44_100])
def test_the_final_energies_are_those_of_the_last_sample(patch, name, seconds):
    """Also where something flies free by then, and is already at the end of its flight of 64 samples. The rows of a
    trace are made by single steps."""
    found = engine.render(patch(name), seconds=seconds).stats.energy
    trace = engine.render(patch(name), seconds=seconds, trace=True).trace
    assert found.final == pytest.approx(trace["total"][-1], rel=1e-12)
    assert found.supplied == pytest.approx(trace["supplied"][-1], rel=1e-12)
    assert found.dissipated == pytest.approx(trace["dissipated"][-1], rel=1e-12)


def test_a_mode_that_flies_free_has_the_energy_of_its_decay():
    """E(t) of an oscillator of T60 = 0.7 s: 60 dB in 0.7 s, at the time of the last sample, not up to 64 later."""
    body = {"name": "o", "kind": "oscillator", "mass": 1.0, "frequency": 2000.0, "velocity": 1.0}
    body["damping_rate"] = 2 * 3 * math.log(10) / 0.7
    scene = engine.load({"seconds": 0.5, "body": [body], "pickup": [{"body": "o"}]})
    energy, time = engine.render(scene).stats.energy, (22_050 - 1) / 44_100
    assert energy.final / energy.initial == pytest.approx(10 ** (-6 * time / 0.7), rel=2e-3)


def test_the_ledger_would_see_a_wrong_force(patch, monkeypatch):
    """A compliance that is off by 1e-9 shows: the ledger is measured, not assumed."""
    from engine.assembly import build
    from engine.offline import render

    def off(*arguments):
        built = build.build(*arguments)
        contact = built.model.step.contact
        wrong = contact._replace(compliance=contact.compliance * (1 + 1e-9), compliance_low=contact.compliance_low * 0)
        return built._replace(model=built.model._replace(step=built.model.step._replace(contact=wrong)))

    monkeypatch.setattr(render, "build", off)
    assert engine.render(patch("bouncing_ball")).stats["energy"]["error_max"] > 1e-12
