"""External forces push as they say, and the ledger books their work."""

import numpy as np
import pytest
import soundfile

import engine
from scenes.small import mass, oscillator, scene


def pushed(seconds: float = 0.2, body: dict | None = None, **force) -> engine.Rendering:
    parts = {"body": "body", "amplitude": 3.0} | force
    return engine.render(scene([body or mass()], force=[parts]), seconds=seconds, trace=True)


def test_constant_force_gives_a_parabola():
    trace = pushed(kind="constant").trace
    np.testing.assert_allclose(trace["displacement"][:, 0], 1.5 * trace["time"] ** 2, rtol=1e-10, atol=1e-18)
    np.testing.assert_allclose(trace["supplied"], 3.0 * trace["displacement"][:, 0], rtol=1e-9, atol=1e-18)


def test_a_constant_force_stretches_a_spring():
    """An oscillator settles at f/k, whatever the scheme."""
    body = oscillator(stiffness=500.0, damping=60.0)
    assert pushed(4.0, body, kind="constant").trace["displacement"][-1, 0] == pytest.approx(3 / 500, rel=1e-12)


@pytest.mark.parametrize("start", [0.0, 0.01, 0.0123456])
@pytest.mark.parametrize("duration", [1e-5, 1e-3, 0.0234567])
def test_a_pulse_has_its_impulse(start, duration):
    """Wherever its edges fall between samples."""
    trace = pushed(kind="pulse", start=start, duration=duration).trace
    assert trace["velocity"][-1, 0] == pytest.approx(3.0 * duration, rel=1e-11)
    assert np.all(trace["velocity"][trace["time"] <= start, 0] == 0.0)


@pytest.mark.parametrize("start", [0.0, 0.0123456])
def test_a_half_sine_has_its_impulse(start):
    """2AD/π, at second order."""
    trace = pushed(kind="half_sine", start=start, duration=0.05).trace
    assert trace["velocity"][-1, 0] == pytest.approx(2 * 3.0 * 0.05 / np.pi, rel=1e-6)


@pytest.mark.parametrize("start", [0, 441])
def test_samples_push_from_a_file(tmp_path, monkeypatch, start):
    """At the scene's rate the force is the mean of neighbouring samples (eq. 34)."""
    samples = np.random.default_rng(1).uniform(-0.5, 0.5, 500)
    soundfile.write(tmp_path / "push.wav", samples, 44_100, subtype="DOUBLE")
    monkeypatch.chdir(tmp_path)
    trace = pushed(0.05, kind="file", file="push.wav", start=start / 44_100).trace
    ends = np.concatenate([np.zeros(start), samples, np.zeros(44_100)])[: trace["time"].size]
    means = 3.0 * (ends[1:] + ends[:-1]) / 2
    np.testing.assert_allclose(np.diff(trace["velocity"][:, 0]), means / 44_100, atol=1e-16)


def test_samples_at_another_rate_are_resampled(tmp_path, monkeypatch):
    time = np.arange(9600) / 96_000
    soundfile.write(tmp_path / "push.wav", np.sin(2 * np.pi * 200 * time) * 0.5, 96_000, subtype="DOUBLE")
    monkeypatch.chdir(tmp_path)
    trace = pushed(0.1, kind="file", file="push.wav").trace
    expected = 3.0 * 0.5 * (1 - np.cos(2 * np.pi * 200 * trace["time"])) / (2 * np.pi * 200)
    np.testing.assert_allclose(trace["velocity"][:, 0], expected, atol=3e-5)


def test_a_patch_finds_its_force_file(tmp_path, monkeypatch):
    """Beside itself, wherever it is rendered from; and what is kept of its scene finds it from anywhere else."""
    soundfile.write(tmp_path / "push.wav", np.full(100, 0.25), 44_100, subtype="FLOAT")
    (tmp_path / "p.toml").write_text(
        '[[body]]\nname = "b"\nkind = "mass"\nmass = 2.0\n[[pickup]]\nbody = "b"\n'
        '[[force]]\nbody = "b"\nkind = "file"\nfile = "push.wav"\namplitude = 8.0\nstart = 0.01\n'
    )
    rendering = engine.render(engine.load(tmp_path / "p.toml"), seconds=0.1)
    assert rendering.audio[-1, 0] == pytest.approx(8.0 * 0.25 * 100 / 44_100 / 2.0, rel=1e-9)
    monkeypatch.chdir(tmp_path)
    kept = engine.load("p.toml").model_dump_json(exclude_none=True)
    monkeypatch.chdir("/")
    assert engine.Scene.model_validate_json(kept).force[0].file == str(tmp_path / "push.wav")
