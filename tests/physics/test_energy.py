"""Stored + dissipated - supplied = constant, whatever collides."""

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


@pytest.mark.parametrize("scheme", ["exact", "fdh"])
def test_a_minute_of_collisions_keeps_its_energy(patch, scheme):
    """26 000 collisions of Fig. 6."""
    rendering = engine.render(patch("repelled_oscillator"), seconds=60, scheme=scheme)
    assert rendering.stats["energy"]["error_max"] <= 1e-12
    assert rendering.stats["newton"]["regimes"]["separation"] > 26_000


@pytest.mark.parametrize("scheme", ["exact", "fdh"])
@pytest.mark.parametrize("path", PATCHES, ids=lambda p: p.stem)
def test_the_ledger_closes(path, scheme):
    """With everything on."""
    scene = engine.load(path)
    rendering = engine.render(scene, scheme=scheme, seconds=min(3.0, scene.seconds))
    assert rendering.stats["energy"]["error_max"] <= 1e-12
    assert rendering.stats["newton"]["unconverged"] == 0


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
