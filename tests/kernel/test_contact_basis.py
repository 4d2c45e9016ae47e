"""Many points close together are solved in the space of a basis: the same forces, faster; eight numbers at a time."""

import math

import numba
import numpy as np
import pytest
from conftest import mostly_hard
from later import import_later

import engine
from bench.scenes.families import tanpuras
from engine.assembly import contact_points
from engine.assembly.build import build
from engine.assembly.initial_state import allocate_scratch
from engine.compiler.decorators import kernel
from engine.compiler.lanes import lane_sum, load_lanes, multiply_add, splat, store_lanes, where_positive
from engine.kernel.contact.contact_law import LossyLaw
from engine.kernel.contact.reduced_contact_solver import basis_of_island, solve_reduced
from engine.kernel.data.enums import Row
from engine.kernel.data.laws import select_law
from engine.kernel.data.model import BasisCoefficients, ContactBasis
from engine.kernel.data.state import Scratch
from engine.live.player import Player

mpmath = import_later("mpmath")


@kernel
def reduced(law, loss_rate, basis, coefficients, s, g, scratch):
    return solve_reduced(
        LossyLaw(law, loss_rate, None), basis_of_island(basis, coefficients, s.shape[0]), s, g, scratch
    )


def solved(law, loss_rate, u: np.ndarray, s: np.ndarray, g: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
    """Evaluations, forces and steps of contacts that move by B = U·Uᵀ; U [contacts, rank]."""
    found = contact_points.BasisOfIsland(u, np.zeros((u.shape[1],) * 2), np.zeros((u.shape[1], 1)))
    begins = np.zeros(u.shape[1], np.int64)
    basis = ContactBasis(None, begins, begins, begins)
    entries = contact_points.entries_by_row(found), contact_points.products_by_contact(found)
    scratch = Scratch(*(x[0] for x in allocate_scratch(1, s.size)))
    evaluations = reduced(law, loss_rate, basis, BasisCoefficients(None, *entries), s, g, scratch)
    return evaluations, scratch.vectors[Row.FORCE, : s.size].copy(), scratch.vectors[Row.STEP, : s.size].copy()


def exact_mean_force(stiffness, alpha, rate, s, eta) -> "mpmath.mpf":
    """What the law says for a step: the discrete gradient of its potential, times 1 + μη/h where that is positive."""
    s, eta = mpmath.mpf(s), mpmath.mpf(eta)
    n = mpmath.mpf(alpha) + 1
    gained = (max(s + eta, 0) ** n - max(s, 0) ** n) / n
    return stiffness * gained / eta * max(0, 1 + rate * eta)


@pytest.mark.hard
@pytest.mark.parametrize("alpha", mostly_hard([1.0, 1.3, 1.5, 2.0, 2.5, 3.0], 1.5, 2.5))
@pytest.mark.parametrize("loss", [0.0, 1e3])
def test_forces_are_on_their_laws_and_move_the_bodies(alpha, loss):
    """Random steps of 10 to 40 points of a smooth bridge: with fifty digits, every force is that of its law for the
    step it is said to take, to 1e-9 of all forces; and the steps are what the forces leave of the free moves."""
    rng = np.random.default_rng(5)
    for trial in range(40):
        contacts, rank = int(rng.integers(10, 41)), int(rng.integers(1, 6))
        x = np.linspace(-1, 1, contacts)
        u = 1e-3 * x[:, None] ** np.arange(rank) * 10.0 ** -np.arange(rank)
        stiffness = 10 ** rng.uniform(5, 11)
        s = 10 ** rng.uniform(-8, -5) * (rng.uniform(-1.5, 0.5) - x**2 + 0.05 * rng.normal(size=contacts))
        g = 10 ** rng.uniform(-8, -5) * (rng.normal() + 0.3 * rng.normal() * x)
        law = select_law(np.array([alpha]))(np.full(contacts, stiffness / (alpha + 1)), np.full(contacts, alpha))
        rates = np.full(contacts, loss) if loss else None
        evaluations, force, eta = solved(law, rates, u, s, g)
        assert 0 < evaluations <= 40, trial
        assert np.all(force >= 0.0)
        moved = g - u @ (u.T @ force)
        assert np.abs(eta - moved).max() <= 1e-13 * (np.abs(g).max() + np.abs(u @ (u.T @ force)).max())
        with mpmath.workdps(50):
            for k in np.flatnonzero((s > 0) | (s + eta > 0)):
                exact = exact_mean_force(stiffness, alpha, loss, s[k], eta[k])
                slope = stiffness * alpha * max(s[k], s[k] + eta[k]) ** (alpha - 1)
                rounding = slope * 1e-15 * (abs(s[k]) + np.abs(g).max())
                assert abs(exact - force[k]) <= 1e-9 * force.sum() + rounding


@pytest.mark.parametrize(
    "exponent, loss, order, substeps",
    mostly_hard(
        [(1.5, 0.0, 2, 1), (1.5, 0.5, 2, 1), (1.3, 0.5, 2, 1), (1.5, 0.0, 4, 1), (1.3, 0.5, 2, 3)], (1.3, 0.5, 2, 1)
    ),
)
def test_motion_is_that_of_the_other_solve(exponent, loss, order, substeps, monkeypatch):
    """A plucked string on a bridge of 30 points: the same displacement, force and energies as solved contact by
    contact, as far as chaos allows; and the ledger closes."""
    scene = tanpuras(1, 30, exponent)
    contact = scene.contact[0].model_copy(update={"loss": loss})
    scene = scene.model_copy(update={"contact": [contact]})
    found = engine.render(scene, seconds=0.06, trace=True, order=order, substeps=substeps)
    (shapes,) = build(scene, 44_100.0).layout.points.contact_shapes
    assert shapes.basis_use is contact_points.BasisUse.FIRST
    monkeypatch.setattr(contact_points, "MIN_CONTACTS", 1000)
    other = engine.render(scene, seconds=0.06, trace=True, iterations=1000, order=order, substeps=substeps)
    assert found.stats.energy.error_max <= 1e-12
    for name in ("displacement", "force", "contact"):
        a, b = found.trace[name], other.trace[name]
        assert np.abs(a - b).max() <= 1e-5 * np.abs(b).max(), name


def test_two_bodies_that_touch_at_many_points():
    """A heavy plate strip falls on a string along twelve points: momentum of both, and the ledger."""
    points = [0.5 + 1e-4 * n for n in range(12)]
    scene = engine.Scene.model_validate(
        {
            "body": [
                {
                    "name": "string",
                    "kind": "string",
                    "length": 0.6,
                    "linear_density": 5e-3,
                    "tension": 600.0,
                    "modes": 40,
                },
                {"name": "bar", "kind": "bar", "length": 0.3, "frequency": 200.0, "mass": 0.02, "modes": 6}
                | {"sigma0": 1.0},
            ],
            "contact": [
                {"body": "string", "at": points, "on": "bar", "on_at": points, "side": "above"}
                | {"gap": 1e-5, "stiffness": 1e7, "exponent": 1.5, "loss": 0.3}
            ],
            "force": [{"body": "string", "at": 0.37, "kind": "pluck", "amplitude": 3.0, "duration": 2e-3}],
            "pickup": [{"body": "string", "at": 0.1}],
        }
    )
    (shapes,) = build(scene, 44_100.0).layout.points.contact_shapes
    assert shapes.basis_use is contact_points.BasisUse.FIRST
    rendering = engine.render(scene, seconds=0.3, trace=True)
    assert np.count_nonzero(rendering.trace["force"].any(axis=1)) > 100
    assert rendering.stats.energy.error_max <= 1e-12
    assert np.all(rendering.trace["force"] >= 0.0)


@pytest.mark.hard
@pytest.mark.parametrize("name", ["tanpura", "tanpura_drone", "guitar_frets", "bass_frets", "snare_wires"])
def test_no_solve_of_a_shipped_patch_is_capped(name):
    stats = engine.render(engine.load(name)).stats
    assert stats.newton.solve_outcomes.capped == 0
    assert stats.newton.solve_outcomes.newton > 0 or name == "bass_frets"


def test_a_voice_keeps_its_basis_at_another_pitch():
    """A tanpura of two voices, one of them tuned up, has that pitch; energies stay in balance."""
    scene = tanpuras(1, 30, 1.5)
    player = Player(scene, gain=1e-3, seconds=math.inf, voices=2, lowest=0.5)
    player.tune(1, 1.5)
    player.pluck("string0_1")
    out = np.zeros((22_050, player.channels), np.float32)
    player.render_into(out)
    assert player.meter()["energy_error"] <= 1e-12
    power = np.abs(np.fft.rfft(out[4410:, 0] * np.hanning(len(out) - 4410)))
    frequency = np.fft.rfftfreq(len(out) - 4410, 1 / 44_100)
    low = (frequency > 100) & (frequency < 300)
    assert frequency[low][power[low].argmax()] == pytest.approx(1.5 * 130.9, abs=2.5)


# --- eight numbers at a time


@numba.njit(error_model="numpy")
def operate(a, b, out):
    x, y = load_lanes(a, 0), load_lanes(b, 0)
    store_lanes(out, 0, x + y)
    store_lanes(out, 8, x - 2.0 * y)
    store_lanes(out, 16, x / y)
    store_lanes(out, 24, math.sqrt(x))
    store_lanes(out, 32, multiply_add(x, y, splat(1.0)))
    store_lanes(out, 40, where_positive(x - 0.5, y, 7.0))
    return lane_sum(x)


def test_lanes_are_rounded_as_numbers_are():
    rng = np.random.default_rng(1)
    a, b, out = rng.random(8), rng.random(8), np.zeros(48)
    total = operate(a, b, out)
    assert total == ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    np.testing.assert_array_equal(out[:8], a + b)
    np.testing.assert_array_equal(out[8:16], a - 2.0 * b)
    np.testing.assert_array_equal(out[16:24], a / b)
    np.testing.assert_array_equal(out[24:32], np.sqrt(a))
    with mpmath.workdps(60):
        fused = [float(mpmath.mpf(x) * mpmath.mpf(y) + 1) for x, y in zip(a, b, strict=True)]
    np.testing.assert_array_equal(out[32:40], fused)
    np.testing.assert_array_equal(out[40:], np.where(a > 0.5, b, 7.0))
