"""Numbers the physics fixes, reached at second order in the step."""

import math

import numpy as np
import pytest
import scipy
from conftest import slope

import engine
from bench.scenes.small import barrier, mass, oscillator, scene

RATES = [96_000, 192_000, 384_000]


def bounce(
    alpha: float, rate: int, loss: float = 0.0, stiffness: float = 1e8, order: int = 2
) -> tuple[float, float, float]:
    """Contact time, deepest compression and rebound speed of 10 g at 1 m/s that starts on the barrier."""
    rendering = engine.render(
        scene(
            [mass(mass=0.01, velocity=1.0)],
            contact=[barrier(stiffness=stiffness, exponent=alpha, loss=loss)],
        ),
        seconds=8e-3,
        samplerate=rate,
        order=order,
        trace=True,
    )
    place, velocity = rendering.trace["displacement"][:, 0], rendering.trace["velocity"][:, 0]
    assert place[-1] < 0, "still in contact"
    out = velocity[-1]
    time = rendering.trace["time"][-1] - place[-1] / out  # it coasts since it left
    n = int(np.argmax(place))
    a, b, c = place[n - 1 : n + 2]
    return time, b - (a - c) ** 2 / (8 * (a - 2 * b + c)), -out


@pytest.mark.parametrize("alpha", [1.0, 1.3, 1.5, 2.0, 2.5, 3.0])
def test_lossless_bounce(alpha):
    """y_max = ((α+1)mv²/2k)^(1/(α+1)); τ = C(α)·y_max/v; rebound at v."""
    deepest = 1e-3
    stiffness = (alpha + 1) * 0.01 / 2 / deepest ** (alpha + 1)
    gamma = scipy.special.gamma
    factor = 2 * math.sqrt(math.pi) * gamma(1 + 1 / (alpha + 1)) / gamma(0.5 + 1 / (alpha + 1))
    errors = []
    for rate in RATES:
        time, reached, out = bounce(alpha, rate, stiffness=stiffness)
        assert out == pytest.approx(1.0, abs=1e-13)
        errors.append((time / (factor * deepest) - 1, reached / deepest - 1))
    times, depths = zip(*errors, strict=True)
    assert abs(times[-1]) < 5e-4
    assert abs(depths[-1]) < 5e-4
    assert slope(RATES, times) == pytest.approx(-2, abs=0.1)
    assert max(abs(d) * r * r for d, r in zip(depths, RATES, strict=True)) < 4 * abs(depths[0]) * RATES[0] ** 2


def test_example_of_a_bounce():
    """The worked example of ORACLES 1: m = 10 g, k = 1e8, v = 1 m/s, α = 1.5 and 2.5."""
    time, deepest, _ = bounce(1.5, 768_000)
    assert time == pytest.approx(3.218065e-4, rel=2e-4)
    assert deepest == pytest.approx(1.0933621e-4, rel=2e-4)
    assert bounce(2.5, 768_000)[0] == pytest.approx(4.4044671e-3, rel=2e-6)


@pytest.mark.parametrize("alpha", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("loss", [0.01, 0.1, 0.5, 1.0, 2.0, 10.0])
def test_restitution_of_a_lossy_contact(alpha, loss):
    """1 + μv_out = -W0(-(1 + μv)·exp(-(1 + μv))), whatever stiffness and exponent."""
    start = 1 + loss
    expected = (1 + float(scipy.special.lambertw(-start * math.exp(-start)).real)) / loss
    stiffness = {1.0: 1e5, 1.5: 1e7, 3.0: 1e11}[alpha]
    errors = [bounce(alpha, rate, loss, stiffness)[2] - expected for rate in RATES]
    assert abs(errors[-1]) < 1e-4
    assert slope(RATES, errors) == pytest.approx(-2, abs=0.2)
    finer = [bounce(alpha, rate, loss, stiffness, order=4)[2] - expected for rate in RATES]
    assert np.all(np.abs(finer) < 0.7 * np.abs(errors))  # where loss is strong, order 4 is order 2
    if loss <= 0.1:
        assert np.all(np.abs(finer) < 4e-3 * np.abs(errors))


def test_oscillator_resting_on_a_linear_barrier():
    """Period π/ω0 + π/√(ω0² + k/m), at second order."""
    omega, stiffness = 2 * math.pi * 300, 4e7
    period = math.pi / omega + math.pi / math.sqrt(omega**2 + stiffness)
    errors = []
    for rate in (44_100, 88_200, 176_400):
        rendering = engine.render(
            scene(
                [oscillator(frequency=300.0, displacement=-1e-3)],
                contact=[barrier(stiffness=stiffness, exponent=1.0)],
            ),
            seconds=0.2,
            samplerate=rate,
            trace=True,
        )
        x = rendering.trace["displacement"][:, 0]
        up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
        v = rendering.trace["velocity"][up, 0]
        times = up + rate * (-x[up] / v)
        errors.append((times[-1] - times[0]) / (len(times) - 1) / rate / period - 1)
    assert abs(errors[0]) < 3e-3
    assert slope([1, 2, 4], errors) == pytest.approx(-2, abs=0.25)


def roots(rendering: engine.Rendering) -> np.ndarray:
    """The two roots z of x[n+2] = 2·Re z·x[n+1] - |z|²·x[n], fitted to the whole trajectory."""
    x = rendering.trace["displacement"][:, 0]
    two, one = np.linalg.lstsq(np.stack([x[1:-1], x[:-2]], 1), x[2:], rcond=None)[0]
    return np.roots([1.0, -two, -one])


@pytest.mark.parametrize("rate", [4_000, 44_100, 192_000])
@pytest.mark.parametrize(("frequency", "damping"), [(440.0, 0.0), (440.0, 8.0), (1900.0, 300.0), (100.0, 50.0)])
def test_free_vibration_is_in_tune_at_any_rate(frequency, damping, rate):
    """With `exact`, frequency and decay of a mode are its own, to 1e-9."""
    body = oscillator(frequency=frequency, damping_rate=damping, displacement=1e-3)
    z = roots(engine.render(scene([body]), seconds=0.05, samplerate=rate, trace=True))[0]
    omega, sigma = 2 * math.pi * frequency, damping / 2
    assert abs(np.angle(z)) * rate == pytest.approx(math.sqrt(omega**2 - sigma**2), rel=1e-9)
    assert -np.log(abs(z)) * rate == pytest.approx(sigma, rel=1e-9, abs=1e-7)


def test_overdamped_vibration_decays_at_both_its_rates():
    body = oscillator(frequency=10.0, damping_rate=400.0, displacement=1e-3)
    z = roots(engine.render(scene([body]), seconds=0.05, samplerate=8000, trace=True))
    omega, sigma = 2 * math.pi * 10, 200.0
    slow = math.sqrt(sigma**2 - omega**2)
    np.testing.assert_allclose(sorted(-np.log(z.real) * 8000), [sigma - slow, sigma + slow], rtol=1e-7)


@pytest.mark.parametrize("frequency", [440.0, 5000.0, 18_000.0, 40_000.0])
def test_fdh_detunes_by_the_bilinear_law(frequency):
    """With `fdh`, a mode vibrates at (2/h)·atan(ωh/2) (paper, sec. 4)."""
    body = oscillator(frequency=frequency, displacement=1e-3)
    z = roots(engine.render(scene([body]), seconds=0.05, scheme="fdh", trace=True))[0]
    omega = 2 * math.pi * frequency
    assert abs(np.angle(z)) == pytest.approx(2 * math.atan(omega / 88_200), rel=1e-9)
    assert abs(z) == pytest.approx(1.0, abs=1e-12)


def test_a_damped_mass_coasts_exactly():
    """v(t) = v0·exp(-γt), x(t) = v0·(1 - exp(-γt))/γ, at any rate."""
    rendering = engine.render(scene([mass(damping_rate=30.0, velocity=2.0)]), seconds=0.1, samplerate=8000, trace=True)
    time = rendering.trace["time"]
    np.testing.assert_allclose(rendering.trace["velocity"][:, 0], 2 * np.exp(-30 * time), rtol=1e-12)
    np.testing.assert_allclose(
        rendering.trace["displacement"][:, 0], 2 / 30 * -np.expm1(-30 * time), rtol=1e-11, atol=1e-16
    )


@pytest.mark.parametrize("alpha", [1.0, 1.5, 2.0, 2.7, 4.0])
def test_a_resting_ball_stays(alpha):
    """Static compression (mg/kc)^(1/α); a ball placed there stays there to 1e-15 m."""
    stiffness, rest = 1e7, (9.81 / 1e7) ** (1 / alpha)
    rendering = engine.render(
        scene(
            [mass(displacement=-rest)],
            gravity=9.81,
            contact=[barrier(side="below", stiffness=stiffness, exponent=alpha)],
        ),
        seconds=0.5,
        trace=True,
    )
    assert np.max(np.abs(rendering.trace["displacement"][:, 0] + rest)) < 1e-15
    assert rendering.trace["force"][1:, 0] == pytest.approx(9.81, rel=1e-11)


def test_momentum_is_conserved_when_two_bodies_collide():
    bodies = [mass(mass=0.3, velocity=2.0), {"name": "other", "kind": "mass", "mass": 0.7, "displacement": 1e-3}]
    contact = [{"body": "body", "on": "other", "stiffness": 1e7, "exponent": 1.5}]
    rendering = engine.render(scene(bodies, contact=contact), seconds=0.02, trace=True)
    velocity = rendering.trace["velocity"]
    np.testing.assert_allclose(velocity @ [0.3, 0.7], 0.6, rtol=1e-13)
    np.testing.assert_allclose(velocity[-1], [0.6 - 0.7 * 2.0, 0.6 + 0.3 * 2.0], rtol=1e-12)  # elastic
