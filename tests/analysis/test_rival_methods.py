"""The methods of others converge as their authors say, and are what they are called."""

import numpy as np
import pytest
from conftest import slope

from bench.rivals.single_body import SingleBody, simulate
from bench.ruler.contact_ruler import load_problem
from bench.ruler.contact_ruler.problem import Friction, Problem, energy_of
from bench.ruler.methods import METHODS
from bench.ruler.methods.common import was_applicable
from bench.ruler.methods.dop853 import simulate_dop853
from bench.ruler.problems import as_problem, ruler_scene
from bench.ruler.stability import largest_stable_stiffness, meeting_a_barrier

SECOND = ["Störmer-Verlet", "Störmer-Verlet, linear part exact", "implicit midpoint"]
FOURTH = ["RK4", "RK4, linear part exact"]
FDN = ["FDN", "FDN, linear part exact"]
RIGID = [name for name in METHODS if "Moreau" in name]


def shortened(problem: Problem, seconds: float) -> Problem:
    """The beginning of a problem."""
    return problem._replace(frames=round(seconds * problem.samplerate))


def of_the_ruler(name: str, seconds: float = 0.01) -> Problem:
    """The beginning of a problem of the ruler."""
    return shortened(as_problem(ruler_scene(name)), seconds)


def error(found: np.ndarray, right: np.ndarray) -> float:
    """Root mean square of the difference, relative."""
    return float(np.sqrt(np.mean((found - right) ** 2) / np.mean(right**2)))


def errors(name: str, problem: Problem, steps: list[int]) -> list[float]:
    """Errors of the displacement at several numbers of steps per sample."""
    right = simulate_dop853(problem, 1e-12).displacement
    return [error(METHODS[name].simulate(problem, n).displacement, right) for n in steps]


def check_order(name: str, problem: Problem, order: float, steps: list[int]) -> None:
    """The error falls with a power of the step."""
    assert slope([1.0 / n for n in steps], errors(name, problem, steps)) == pytest.approx(order, abs=0.4)


@pytest.mark.hard
@pytest.mark.parametrize("name", SECOND)
def test_methods_of_order_2(name):
    check_order(name, of_the_ruler("repelled_oscillator"), 2, [2, 4, 8, 16])


@pytest.mark.hard
@pytest.mark.parametrize("name", SECOND)
@pytest.mark.parametrize("problem", ["hammer_c2", pytest.param("hammer_c4", marks=pytest.mark.slow)])
def test_methods_of_order_2_with_many_modes(name, problem):
    check_order(name, of_the_ruler(problem), 2, [8, 16, 32])


@pytest.mark.hard
@pytest.mark.parametrize("name", FOURTH)
def test_methods_of_order_4_while_the_contact_is_closed(name):
    problem = shortened(meeting_a_barrier(1e10)._replace(barrier=np.array([-2e-3])), 0.01)
    check_order(name, problem, 4, [2, 4, 8])


@pytest.mark.hard
@pytest.mark.parametrize("name", FOURTH)
def test_methods_of_order_4_where_the_contact_closes(name):
    found = errors(name, of_the_ruler("hammer_c2"), [2, 4, 8, 16])
    assert slope([0.5, 0.25, 0.125, 0.0625], found) > 3.3  # the exponent is 2.3


@pytest.mark.hard
@pytest.mark.parametrize("name", SECOND)
def test_methods_of_order_2_on_a_string_that_stretches(name):
    check_order(name, of_the_ruler("stretching_string", 0.003), 2, [8, 16, 32])


@pytest.mark.hard
@pytest.mark.parametrize("name", FOURTH)
def test_methods_of_order_4_on_a_string_that_stretches(name):
    check_order(name, of_the_ruler("stretching_string", 0.003), 4, [8, 16, 32])


@pytest.mark.hard
@pytest.mark.parametrize("name", FDN + RIGID)
def test_methods_of_linear_modes_say_that_a_string_that_stretches_is_not_for_them(name):
    result = METHODS[name].simulate(of_the_ruler("stretching_string"), 1)
    assert not was_applicable(result) and np.isnan(result.displacement).all()


FRICTION = ["Störmer-Verlet, linear part exact", "RK4, linear part exact", "friction curve, hysteresis"]


@pytest.mark.hard
@pytest.mark.parametrize("name", [n for n in METHODS if n not in FRICTION and n != "DOP853"])
def test_methods_of_contacts_say_that_friction_is_not_for_them(name):
    result = METHODS[name].simulate(of_the_ruler("bowed_string"), 1)
    assert not was_applicable(result) and np.isnan(result.displacement).all()


@pytest.mark.hard
def test_the_friction_curve_says_that_contacts_are_not_for_it():
    assert not was_applicable(METHODS["friction curve, hysteresis"].simulate(of_the_ruler("hammer_c2"), 1))


def bowed(seconds: float, **changes: float) -> Problem:
    """The beginning of the bowed string, with other numbers of friction."""
    problem = of_the_ruler("bowed_string", seconds)
    law = Friction(*problem.friction)._replace(**{name: np.array([value]) for name, value in changes.items()})
    return problem._replace(friction=np.array(law))


@pytest.mark.hard
@pytest.mark.parametrize(("name", "order"), [(FRICTION[0], 2), (FRICTION[1], 4)])
def test_orders_while_a_bow_sticks(name, order):
    check_order(name, bowed(0.001, force=1e3), order, [8, 16, 32])


@pytest.mark.hard
@pytest.mark.parametrize("name", FRICTION[:2])
def test_errors_vanish_where_a_bow_sticks_and_slides(name):
    few, _, many = errors(name, bowed(0.001), [8, 32, 128])
    assert many < few / 20 and many < 1e-6


@pytest.mark.hard
def test_dop853_meets_the_reference_of_a_bowed_string():
    problem, reference = load_problem("bowed_string")
    coarse, fine = (simulate_dop853(shortened(problem, 0.004), tolerance).displacement for tolerance in (1e-6, 1e-9))
    right = reference.displacement[: fine.size]
    assert error(fine, right) < 1e-6 and error(coarse, right) < 1e-3


@pytest.mark.hard
def test_the_friction_curve_is_the_law_of_a_stiff_bristle_without_weakening():
    """With one coefficient there is nothing to choose, and a bristle of 1e7 N/m hardly gives way."""
    problem = bowed(0.004, static=0.5, dynamic=0.5, bristle=1e7)
    by_curve = METHODS["friction curve, hysteresis"].simulate(problem, 64)
    by_bristle = METHODS["Störmer-Verlet, linear part exact"].simulate(problem, 256)
    assert error(by_curve.displacement, by_bristle.displacement) < 1e-3


@pytest.mark.hard
@pytest.mark.parametrize("name", SECOND)
def test_methods_of_order_2_with_contact_loss(name):
    check_order(name, of_the_ruler("hammer_c4", 0.003), 2, [16, 32, 64])


@pytest.mark.hard
@pytest.mark.parametrize("exponent", [1.0, 3.0])
@pytest.mark.parametrize("name", FDN)
def test_fdn_is_of_order_2_for_its_exponents(name, exponent):
    problem = of_the_ruler("repelled_oscillator")
    stiffness = problem.stiffness * (1e-3) ** (problem.exponent - exponent)
    check_order(name, problem._replace(exponent=np.array([exponent]), stiffness=stiffness), 2, [4, 8, 16, 32])


@pytest.mark.hard
@pytest.mark.parametrize("name", FDN)
def test_fdn_is_not_applicable_to_other_exponents(name):
    found = METHODS[name].simulate(of_the_ruler("hammer_c2"), 1)
    assert not was_applicable(found) and np.isnan(found.displacement).all()


@pytest.mark.hard
@pytest.mark.parametrize(
    ("name", "older"),
    [
        ("Störmer-Verlet", "Störmer-Verlet"),
        ("RK4", "RK4"),
        ("implicit midpoint", "implicit midpoint"),
        ("FDN", "FDN (eq. 4)"),
    ],
)
def test_one_body_moves_as_by_the_older_kernels(name, older):
    problem = shortened(meeting_a_barrier(1e9)._replace(exponent=np.array([3.0])), 0.02)
    found = METHODS[name].simulate(problem, 1)
    body = SingleBody(problem.omega[0] ** 2, 1e9, 3.0, problem.barrier[0], -1.0, 0.0)
    rows = simulate(older, body, problem.q[0], problem.p[0], 1.0 / problem.samplerate, problem.frames + 1)
    assert found.displacement == pytest.approx(rows[:, 0], abs=1e-12)
    assert found.p[:, 0] == pytest.approx(rows[:, 1], abs=1e-8)


def bounced_rigidly(problem: Problem, restitution: float) -> np.ndarray:
    """The displacement of the oscillator of the stability problem at a rigid barrier; for restitution 1 or 0."""
    omega, barrier, amplitude = problem.omega[0], problem.barrier[0], -problem.q[0]
    meets = np.arccos(-barrier / amplitude) / omega
    t = np.arange(problem.frames + 1) / problem.samplerate
    if restitution == 1.0:  # it comes back as it went, and so on
        late = np.mod(t, 2.0 * meets)
        return -amplitude * np.cos(omega * np.minimum(late, 2.0 * meets - late))
    return np.where(t < meets, -amplitude * np.cos(omega * t), barrier * np.cos(omega * (t - meets)))


@pytest.mark.hard
@pytest.mark.parametrize("name", RIGID)
def test_moreau_jean_converges_to_the_rigid_contact(name):
    problem = shortened(meeting_a_barrier(1e9), 0.003)  # until it comes back, with restitution 0 to just touch
    right = bounced_rigidly(problem, float(name[-1]))
    found = [error(METHODS[name].simulate(problem, n).displacement, right) for n in (1, 16, 256)]
    assert found[2] < 0.1 * found[0] and found[2] < 2e-3


@pytest.mark.hard
def test_moreau_jean_keeps_the_energy_of_elastic_impacts():
    problem = of_the_ruler("joined", 0.05)
    found = METHODS["Moreau-Jean, θ = 1/2, e = 1"].simulate(problem, 1)
    energy = energy_of(problem._replace(stiffness=0.0 * problem.stiffness), found.q, found.p)
    assert found.force.max() > 0.0 and energy == pytest.approx(energy[0], rel=1e-10)


@pytest.mark.hard
@pytest.mark.parametrize("name", SECOND + FOURTH + ["DOP853"])
def test_force_is_the_mean_over_the_sample(name):
    problem = of_the_ruler("barrier", 0.02)
    found = METHODS[name].simulate(problem, 1e-9 if name == "DOP853" else 16)
    momentum = np.diff(found.p[:, 0]) * problem.samplerate
    assert -found.force @ problem.shapes[:, 0] == pytest.approx(momentum, abs=1e-6 * np.abs(momentum).max())


@pytest.mark.hard
@pytest.mark.parametrize("name", SECOND + FOURTH)
def test_without_contact_an_exact_linear_part_is_exact(name):
    problem = of_the_ruler("hammer_c2")
    problem = problem._replace(barrier=problem.barrier + 1.0, weight=0.1 + problem.weight)
    found = METHODS[name].simulate(problem, 1)
    fine = METHODS[name].simulate(problem, 16)
    assert error(fine.displacement, simulate_dop853(problem, 1e-12).displacement) < (1e-7 if "exact" in name else 1e-2)
    exact = error(found.displacement, fine.displacement) < 1e-11 and error(found.p, fine.p) < 1e-11
    assert exact == ("exact" in name)


@pytest.mark.slow
@pytest.mark.parametrize("problem", ["walls", "drum", "snare", "frets", "joined"])
@pytest.mark.parametrize("name", SECOND + FOURTH)
def test_methods_converge_on_hard_problems(name, problem):
    found = errors(name, of_the_ruler(problem, 0.005), [16, 256])
    assert found[1] < 0.1 * found[0] and found[1] < 1e-3


@pytest.mark.hard
def test_the_midpoint_solves_its_equations():
    problem = of_the_ruler("snare", 0.005)
    found = METHODS["implicit midpoint"].simulate(problem, 1)
    middle = 0.5 * (found.q[1:] + found.q[:-1])
    s = np.maximum(middle @ problem.shapes.T - problem.barrier, 0.0)
    rate = np.diff(found.q, axis=0) @ problem.shapes.T * problem.samplerate
    right = problem.stiffness * s**problem.exponent * np.maximum(0.0, 1.0 + problem.loss * rate)
    assert found.force == pytest.approx(right, abs=1e-8 * right.max())


@pytest.mark.slow
def test_which_methods_are_stable():
    verlet = largest_stable_stiffness(METHODS["Störmer-Verlet"].simulate)
    assert 3e13 < verlet < 5e13  # it leaves with ω of the contact times h near 2
    assert np.isinf(largest_stable_stiffness(METHODS["Moreau-Jean, linear part exact, e = 0"].simulate))
    assert largest_stable_stiffness(METHODS["FDN"].simulate) == 0.0  # not applicable to the exponent


@pytest.mark.hard
def test_blowing_up_is_no_exception():
    problem = of_the_ruler("tanpura", 0.003)
    for name in [*SECOND, *FOURTH, *FDN, *RIGID]:
        with np.errstate(all="ignore"):
            found = METHODS[name].simulate(problem, 1)
            energy = energy_of(problem, found.q, found.p)
        assert energy.shape == (problem.frames + 1,) and found.seconds > 0.0
