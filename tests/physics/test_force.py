"""External forces push as they say, and the ledger books their work."""

import numpy as np
import pytest
import scipy
import soundfile

import engine
from bench.scenes.small import mass, oscillator, scene
from engine.assembly.external_forces import force_table
from engine.patch.tables import NoiseForce

BAND = [50.0, 1000.0]  # Hz


def pushed(seconds: float = 0.2, body: dict | None = None, **force) -> engine.Rendering:
    parts = {"body": "body", "amplitude": 3.0} | force
    return engine.render(scene([body or mass()], force=[parts]), seconds=seconds, trace=True)


def test_constant_force_gives_a_parabola():
    trace = pushed(kind="constant").trace
    np.testing.assert_allclose(trace["displacement"][:, 0], 1.5 * trace["time"] ** 2, rtol=1e-10, atol=1e-18)
    np.testing.assert_allclose(trace["supplied"], 3.0 * trace["displacement"][:, 0], rtol=1e-9, atol=1e-18)


def test_a_constant_force_stretches_a_spring():
    """An oscillator settles at f/k, whatever the scheme."""
    body = oscillator(stiffness=500.0, damping_rate=60.0)
    assert pushed(4.0, body, kind="constant").trace["displacement"][-1, 0] == pytest.approx(3 / 500, rel=1e-12)


@pytest.mark.parametrize("start", [0.0, 0.01, 0.0123456])
@pytest.mark.parametrize("duration", [1e-5, 1e-3, 0.0234567])
def test_a_pulse_has_its_impulse(start, duration):
    """Wherever its edges fall between samples."""
    trace = pushed(kind="pulse", start=start, duration=duration).trace
    assert trace["velocity"][-1, 0] == pytest.approx(3.0 * duration, rel=1e-11)
    assert np.all(trace["velocity"][trace["time"] <= start, 0] == 0.0)


@pytest.mark.parametrize("start", [0.0, 0.01, 0.0123456])
@pytest.mark.parametrize("duration", [1e-9, 2e-5, 3e-4, 4e-4, 0.05])
def test_a_half_sine_has_its_impulse(start, duration):
    """2AD/π, also if both its edges fall between the same two samples."""
    trace = pushed(kind="half_sine", start=start, duration=duration).trace
    assert trace["velocity"][-1, 0] == pytest.approx(2 * 3.0 * duration / np.pi, rel=1e-11)
    assert np.all(trace["velocity"][trace["time"] <= start, 0] == 0.0)


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


@pytest.mark.parametrize("start", [0.0, 0.0123456])
def test_a_ramp_is_the_integral_of_its_straight_lines(start):
    """Up to 3 N in 0.05 s, down to 1 N in 0.02 s, and there it stays."""
    lines = [[0.0, 0.0], [0.05, 1.0], [0.07, 1 / 3]]
    trace = pushed(kind="constant", start=start, envelope=lines).trace
    after = trace["time"] - start
    climb, fall = np.clip(after, 0.0, 0.05), np.clip(after - 0.05, 0.0, 0.02)
    impulse = 30 * climb**2 + 3 * fall - 50 * fall**2 + np.clip(after - 0.07, 0.0, None)
    np.testing.assert_allclose(trace["velocity"][:, 0], impulse, atol=1e-14)


def test_a_sine_drives_an_oscillator_as_it_should():
    """Steady state: F/(k - mω² + imγω), F the mean over a step."""
    body = oscillator(mass=0.01, stiffness=400.0, damping_rate=200.0)
    rendering = pushed(1.0, body, kind="sine", frequency=60.0, phase=0.3, duration=2.0, fade=0.1)
    time, displacement = rendering.trace["time"], rendering.trace["displacement"][:, 0]
    omega = 2 * np.pi * 60.0
    response = 3.0 * np.exp(0.3j) / (400.0 - 0.01 * omega**2 + 0.01j * 200.0 * omega)
    late = time > 0.5
    expected = np.imag(response * np.exp(1j * omega * time[late]))
    np.testing.assert_allclose(displacement[late], expected, atol=1e-4 * abs(response))
    assert rendering.stats.energy.error_max < 1e-13


def response(own: float, frequency: float, damping: float = 40.0, **settings) -> complex:
    """Return the displacement of an oscillator that a sine drives, over that of the closed form, in steady state."""
    body = oscillator(mass=1e-3, frequency=own, damping_rate=damping)
    push = {"kind": "sine", "body": "body", "amplitude": 3.0, "frequency": frequency, "duration": 1.0, "fade": 0.1}
    rendering = engine.render(scene([body], force=[push]), seconds=0.5, trace=True, **settings)
    late = rendering.trace["time"] > 0.4
    angle = 2 * np.pi * frequency * rendering.trace["time"][late]
    waves = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    (sine, cosine), *_ = np.linalg.lstsq(waves, rendering.trace["displacement"][late, 0])
    omega, driven = 2 * np.pi * own, 2 * np.pi * frequency
    return complex(sine, cosine) * 1e-3 * (omega**2 - driven**2 + 1j * damping * driven) / 3.0


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("frequency", [2000.0, 10_000.0, 20_000.0])
def test_a_sine_moves_a_mode_of_its_frequency_as_far_as_it_should(frequency, substeps):
    """At any number of steps per sample: a table of the plain means would lose 3.2 dB at 10 kHz in one."""
    assert abs(response(frequency, frequency, substeps=substeps) - 1) < 3e-3


@pytest.mark.parametrize(("own", "frequency"), [(2000.0, 1000.0), (1000.0, 2000.0), (4000.0, 1000.0)])
def test_a_sine_moves_other_modes_with_an_error_of_fourth_order(own, frequency):
    errors = [abs(response(own, frequency, 0.01, samplerate=rate) - 1) for rate in (22_050, 44_100)]
    assert errors[1] < 1e-3 and errors[1] < errors[0] / 13


def test_the_scheme_of_the_paper_has_the_mean_of_a_sine_at_the_ends_of_a_step():
    """Eq. 34: its motion is that of the bilinear transform, whose frequencies are warped, and of no other error."""
    frequency, rate = 5000.0, 44_100
    warped = rate / np.pi * np.tan(np.pi * frequency / rate)
    exact = response(6000.0, frequency, scheme="fdh")
    omega = 2 * np.pi * np.array([6000.0, frequency, warped])
    expected = (omega[0] ** 2 - omega[1] ** 2 + 40j * omega[1]) / (omega[0] ** 2 - omega[2] ** 2 + 200j * omega[2])
    assert exact == pytest.approx(expected, rel=2e-2)


@pytest.mark.parametrize(("samplerate", "share"), [(44_100, 0.68), (192_000, 0.95)])
def test_noise_without_a_band_pushes_with_a_part_of_its_amplitude(samplerate, share):
    assert np.std(noise(samplerate)) == pytest.approx(2.0 * share, rel=0.02)


def noise(samplerate: float = 44_100, **keys) -> np.ndarray:
    force = {"kind": "noise", "body": "b", "amplitude": 2.0, "duration": 4.0} | keys
    return force_table(NoiseForce.model_validate(force), samplerate).values


def test_noise_has_its_level_and_its_band():
    values = noise(band=[200.0, 2000.0])
    frequency, power = scipy.signal.welch(values, 44_100, nperseg=4096)
    inside = (frequency > 300) & (frequency < 1500)
    assert np.std(values) == pytest.approx(2.0, rel=0.03)
    assert np.ptp(10 * np.log10(power[inside])) < 4.0
    for far in (power[(frequency > 30) & (frequency < 50)], power[(frequency > 8000) & (frequency < 9000)]):
        assert np.max(far) < 1e-4 * np.mean(power[inside])


def test_noise_is_that_of_its_seed_at_any_sample_rate():
    slow, again, other, fast = noise(band=BAND), noise(band=BAND), noise(band=BAND, seed=1), noise(88_200, band=BAND)
    assert np.array_equal(slow, again)
    assert abs(np.corrcoef(slow, other)[0, 1]) < 0.1
    coarse = (fast[::2] + fast[1::2]) / 2  # the means over two steps
    assert np.corrcoef(slow[: coarse.size], coarse)[0, 1] > 0.9999


def test_noise_into_a_contact_keeps_the_balance_of_energy():
    body = oscillator(mass=0.01, stiffness=400.0)
    force = {"kind": "noise", "body": "body", "amplitude": 3.0, "duration": 0.15, "fade": 0.02, "band": BAND}
    contact = {"body": "body", "barrier": 1e-4, "stiffness": 1e8, "exponent": 1.5}
    rendering = engine.render(scene([body], force=[force], contact=[contact]), seconds=0.2, trace=True)
    energy = rendering.stats.energy
    assert energy.supplied > 0 and energy.error_max < 1e-12
    assert rendering.trace["contact"].max() > 0
