"""The methods with quadratised potentials and the spline potential: what they conserve, and that they converge.

The two-step kernel is tested first; what compiles the other kernels is marked slow.
"""

import numpy as np
import pytest

import engine
from bench.ruler.contact_ruler import Trajectory, load_problem, score
from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.methods import METHODS as ALL
from bench.ruler.methods import quadratised_contacts as rules
from bench.ruler.methods.common import was_applicable
from bench.ruler.methods.modal_steps import CENTRED, IMPULSE, build_recurrence
from bench.ruler.methods.quadratised import ONE_STEP, run
from bench.ruler.methods.spline import run as run_spline
from bench.ruler.problems import as_problem, ruler_scene

METHODS = {name: method for name, method in ALL.items() if "SAV" in name or "spline" in name}
CONSERVING = (
    rules.PLAIN,
    rules.RELEASED,
    rules.NON_ADHESIVE,
    rules.REGULATED,
    rules.REGULATED_NON_ADHESIVE,
    rules.SINGLE,
)

# fewer of the string: the scheme excites modes near half the sample rate, whose energy is known to fewer digits
EXCITED = (("walls", 800), ("stretching_string", 400), ("joined", 800))


def problem_of(name: str, frames: int | None = None) -> Problem:
    """A problem of the ruler, or its first frames."""
    problem = as_problem(ruler_scene(name))
    return problem if frames is None else problem._replace(frames=frames)


def modal_energy(problem: Problem, trajectory: Trajectory) -> np.ndarray:
    """Energy of the modes at samples, J."""
    q, p = trajectory.q, trajectory.p
    return np.sum(0.5 * p**2 + 0.5 * (problem.omega * q) ** 2 - problem.weight * q, axis=1)


def spread(energy: np.ndarray) -> float:
    """Largest deviation of an energy from its first value, relative."""
    return float(np.max(np.abs(energy - energy[0])) / abs(energy[0]))


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Root-mean-square difference, relative to the second."""
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


@pytest.mark.hard
@pytest.mark.parametrize("rule", CONSERVING)
@pytest.mark.parametrize(("name", "frames"), EXCITED)
def test_two_step_pseudo_energy_is_conserved(rule: int, name: str, frames: int) -> None:
    problem = problem_of(name, frames)
    trajectory, stored = run(problem, 1, rule, IMPULSE, share=0.3)
    recurrence = build_recurrence(problem, 1 / problem.samplerate, IMPULSE)
    now, before = trajectory.q[1:], trajectory.q[:-1]
    modal = (0.5 * (now**2 + before**2) - 0.5 * recurrence.now * now * before) / recurrence.reach
    assert spread(np.sum(modal, axis=1) + stored[:-1]) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("rule", CONSERVING)
@pytest.mark.parametrize(("name", "frames"), EXCITED)
def test_one_step_energy_is_conserved(rule: int, name: str, frames: int) -> None:
    problem = problem_of(name, frames)
    trajectory, stored = run(problem, 1, rule, ONE_STEP, share=0.3)
    assert spread(modal_energy(problem, trajectory)[1:] + stored) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("name", ["walls", "joined", "bouncing_ball"])
def test_spline_energy_is_conserved(name: str) -> None:
    problem = problem_of(name)
    trajectory, stored, _ = run_spline(problem, 1)
    assert spread(modal_energy(problem, trajectory) + stored) < 1e-9


def check_stretching(name: str) -> None:
    """A method is of order 2 where a hammer strikes a string that stretches, and so is its energy."""
    problem, reference = load_problem("stretching_string")
    few, many = (score(problem, reference, METHODS[name].simulate(problem, n)) for n in (4, 16))
    assert few.motion < 6e-3 and few.energy < 1e-3
    assert many.motion < few.motion / 8 and many.energy < few.energy / 8


@pytest.mark.hard
def test_a_two_step_method_is_of_order_2_on_a_string_that_stretches() -> None:
    check_stretching("SAV, one for each contact")


@pytest.mark.hard
def test_a_two_step_method_excites_modes_near_half_the_sample_rate() -> None:
    """In a string that stretches, at one step per sample, where the direction of the force is explicit."""
    problem = problem_of("stretching_string")
    highest = np.argsort(problem.omega)[-3:]
    shares = []
    for steps in (1, 4):
        trajectory, _ = run(problem, steps, rules.PLAIN, IMPULSE)
        energy = 0.5 * trajectory.p**2 + 0.5 * (problem.omega * trajectory.q) ** 2
        shares.append(energy[-1, highest].sum() / energy[-1].sum())
    assert shares[0] > 0.1 and shares[1] < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in METHODS if "SAV" in name])
def test_methods_are_of_order_2_on_a_string_that_stretches(name: str) -> None:
    check_stretching(name)


@pytest.mark.hard
def test_the_spline_is_not_made_for_a_string_that_stretches() -> None:
    problem = problem_of("stretching_string")
    assert not was_applicable(METHODS["quadratic spline potential"].simulate(problem, 1))


@pytest.mark.slow
def test_motion_without_contact_is_exact() -> None:
    problem = problem_of("hammer_c2", 300)
    problem = problem._replace(barrier=problem.barrier + 1.0)
    long, *_ = run_spline(problem, 1)
    for linear in (IMPULSE, ONE_STEP):
        short, _ = run(problem, 4, rules.PLAIN, linear)
        np.testing.assert_allclose(short.q, long.q, atol=1e-11 * np.abs(long.q).max())
        np.testing.assert_allclose(short.p, long.p, atol=1e-9 * np.abs(long.p).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", METHODS)
def test_methods_agree_when_steps_are_short(name: str) -> None:
    problem = problem_of("repelled_oscillator", 600)
    exact = run_spline(problem, 200, knots=2**16)[0].displacement
    assert difference(METHODS[name].simulate(problem, 40).displacement, exact) < 1e-3


@pytest.mark.hard
def test_two_step_contacts_do_not_pull() -> None:
    trajectory, _ = run(problem_of("tanpura", 200), 1, rules.NON_ADHESIVE, IMPULSE)
    assert trajectory.force.max() > 0
    assert trajectory.force.min() >= -1e-12 * trajectory.force.max()


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in METHODS if "adhesive" in name or "spline" in name])
@pytest.mark.parametrize("problem", ["tanpura", "snare"])
def test_contacts_do_not_pull(name: str, problem: str) -> None:
    force = METHODS[name].simulate(problem_of(problem, 200), 1).force
    assert force.max() > 0
    assert force.min() >= -1e-12 * force.max()


@pytest.mark.hard
def test_what_blows_up_is_returned() -> None:
    trajectory, _ = run(problem_of("hammer_c4", 400), 1, rules.PLAIN, CENTRED)
    assert not np.isfinite(trajectory.q).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("problem", ["repelled_oscillator", "hammer_c2"])
def test_methods_converge_to_the_solution(name: str, problem: str) -> None:
    audio = np.asarray(engine.render(ruler_scene(problem), order=6, substeps=16).audio)[:, 0]
    errors = [
        difference(METHODS[name].simulate(problem_of(problem), steps).displacement[: audio.size], audio)
        for steps in (4, 16, 64)
    ]
    assert errors[2] < 2e-4
    assert errors[2] < errors[0] / 8
