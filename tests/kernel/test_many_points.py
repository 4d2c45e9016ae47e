"""Many points close together, which move almost alike, so that their compliance matrix is all but singular."""

import math

import numpy as np
import pytest
from conftest import mostly_hard
from later import import_later
from worst_case_solves import lossy_law

import engine
from bench.scenes.families import tanpuras
from engine.assembly.initial_state import allocate_scratch
from engine.compiler.decorators import kernel
from engine.kernel.contact.coupled_contact_solver import NO_CAP, CoupledProblem, solve_coupled
from engine.kernel.data.enums import Row, SolveStatus
from engine.kernel.data.state import Scratch
from engine.live.player import Player

mpmath = import_later("mpmath")


@kernel
def coupled(law, compliance, s, g, scratch, budget):
    problem = CoupledProblem(law, compliance, s, g, 1e-15, scratch)
    return solve_coupled(problem, NO_CAP, budget)


def solved(law, u: np.ndarray, s: np.ndarray, g: np.ndarray) -> tuple[int, int, np.ndarray, np.ndarray]:
    """Rounds, SolveStatus, forces and steps of contacts that move by B = U·Uᵀ; U [contacts, rank]."""
    scratch = Scratch(*(x[0] for x in allocate_scratch(1, s.size)))
    rounds, status, _ = coupled(law, (u @ u.T).ravel(), s, g, scratch, np.zeros(1, np.int64))
    return rounds, status, scratch.vectors[Row.FORCE, : s.size].copy(), scratch.vectors[Row.STEP, : s.size].copy()


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
        law = lossy_law(np.full(contacts, stiffness / (alpha + 1)), alpha, loss)
        rounds, status, force, eta = solved(law, u, s, g)
        assert status not in (SolveStatus.FAILED, SolveStatus.CAPPED) and rounds <= 40, trial
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
def test_motion_is_that_of_solves_without_a_limit(exponent, loss, order, substeps):
    """A plucked string on a bridge of 30 points: the same displacement and force as with as many rounds as each solve
    takes, as far as chaos allows; and the ledger closes."""
    scene = tanpuras(1, 30, exponent)
    contact = scene.contact[0].model_copy(update={"loss": loss})
    scene = scene.model_copy(update={"contact": [contact]})
    found = engine.render(scene, seconds=0.06, trace=True, order=order, substeps=substeps)
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


def test_a_voice_on_a_bridge_of_many_points_has_another_pitch():
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
