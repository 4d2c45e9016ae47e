"""Contacts that persist: the solve finds the motion that was chosen beforehand, or leaves it to the general one."""

import numpy as np
import pytest
from later import import_later
from worst_case_solves import lossy_law

from engine.assembly.initial_state import allocate_scratch
from engine.compiler.decorators import kernel
from engine.kernel.contact.coupled_contact_solver import CoupledProblem
from engine.kernel.contact.persistent_contact_solver import solve_persistent
from engine.kernel.data.enums import Row
from engine.kernel.data.state import Scratch

mpmath = import_later("mpmath")


@kernel
def solve(law, compliance, s, g, scratch):
    return solve_persistent(CoupledProblem(law, compliance, s, g, 1e-15, scratch))


def mean_force(stiffness: float, alpha: float, rate: float, s: float, eta: float) -> float:
    """kc times the mean of x^α over the step, times 1 + rate·η, at 40 digits."""
    with mpmath.workdps(40):
        s, eta, n = mpmath.mpf(s), mpmath.mpf(eta), mpmath.mpf(alpha) + 1
        mean = s**alpha if eta == 0 else ((s + eta) ** n - s**n) / (n * eta)
        return float(stiffness * mean * (1 + rate * eta))


def chosen(seed: int, stretch: float = 0.4):
    """One to four closed contacts, two open ones, and the solution: (law, B, s, g), η, f."""
    rng = np.random.default_rng(seed)
    closed = int(rng.integers(1, 5))
    n = closed + 2
    stiffness, alpha = 10 ** rng.uniform(5, 11, n), rng.choice([1.0, 1.3, 1.5, 2.3, 3.3, 8.0], n)
    rate = 10 ** rng.uniform(-3, 3, n)
    s = 10 ** rng.uniform(-8, -3, n)
    s[closed:] = -1.0
    eta = s * 10 ** rng.uniform(-7, np.log10(stretch), n) * rng.choice([-1, 1], n)
    eta[closed:] = 0.0
    force = np.array([mean_force(*of) if of[3] > 0 else 0.0 for of in zip(stiffness, alpha, rate, s, eta, strict=True)])
    shapes = rng.normal(size=(n, 4)) * np.sqrt(10 ** rng.uniform(-12, -7))
    compliance = shapes @ shapes.T
    g = eta + compliance @ force
    return (lossy_law(stiffness / (alpha + 1), alpha, rate), compliance, s, g), eta, force


def solved(law, compliance, s, g):
    scratch = Scratch(*(x[0] for x in allocate_scratch(1, s.size)))
    return solve(law, compliance.ravel(), s, g, scratch), scratch.vectors[:, : s.size]


@pytest.mark.hard
def test_the_equations_hold():
    """η + B·f = g and f of the law, to the last digits, and near the chosen motion; nearly always found."""
    found = 0
    for seed in range(400):
        problem, eta, force = chosen(seed)
        law, compliance, s, g = problem
        rounds, vectors = solved(*problem)
        found += rounds > 0
        if rounds > 0:
            step, pushes = vectors[Row.STEP], vectors[Row.FORCE]
            size = np.abs(g) + np.abs(compliance) @ force
            np.testing.assert_array_less(np.abs(step + compliance @ pushes - g), 1e-14 * size)
            closed = s > 0
            alpha = law.elastic.exponent
            stiffness = law.elastic.potential_coefficient * (alpha + 1)
            of_laws = zip(stiffness, alpha, law.loss_rate, s, step, strict=True)
            of_law = [mean_force(*of) for of in of_laws if of[3] > 0]
            np.testing.assert_allclose(pushes[closed], of_law, rtol=2e-14)
            assert not pushes[~closed].any()
            np.testing.assert_allclose(vectors[Row.END], s + step, rtol=1e-15)
            np.testing.assert_allclose(
                vectors[Row.END_FORCE][closed],
                (stiffness * np.maximum(s + step, 0.0) ** alpha)[closed],
                rtol=1e-7,
            )
            if size.max() < 1e3 * np.abs(s[closed]).min():  # well conditioned
                np.testing.assert_allclose(step[closed], eta[closed], rtol=1e-6, atol=1e-9 * s[closed].min())
    assert found >= 350


@pytest.mark.hard
def test_what_is_found_is_on_the_law_whatever_is_given():
    """Light bodies and heavy ones, deep contacts and shallow ones, pushed and pulled: a force pushes, or none is
    found."""
    found = 0
    for seed in range(3000):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 4))
        stiffness, alpha = 10 ** rng.uniform(0, 12, n), rng.choice([1.0, 1.3, 2.0, 3.3, 12.0], n)
        rate, s = rng.choice([0.0, 1.0, 1e3, 3e4], n), 10 ** rng.uniform(-9, 1, n)
        g = s * 10 ** rng.uniform(-9, 2, n) * rng.choice([-1, 1], n)
        shapes = rng.normal(size=(n, 3)) * np.sqrt(10 ** rng.uniform(-14, 3))
        compliance = shapes @ shapes.T
        rounds, vectors = solved(lossy_law(stiffness / (alpha + 1), alpha, rate), compliance, s, g)
        if rounds > 0:
            found += 1
            step, pushes = vectors[Row.STEP], vectors[Row.FORCE]
            of_law = [mean_force(*of) for of in zip(stiffness, alpha, rate, s, step, strict=True)]
            assert (pushes > 0.0).all()
            np.testing.assert_allclose(pushes, of_law, rtol=1e-12)
            np.testing.assert_array_less(
                np.abs(step + compliance @ pushes - g), 1e-13 * (np.abs(g) + np.abs(compliance) @ pushes)
            )
    assert found > 300


@pytest.mark.hard
def test_few_rounds_where_contacts_rest():
    rounds = [solved(*chosen(seed, stretch=1e-2)[0])[0] for seed in range(200)]
    assert np.mean(np.array(rounds) > 0) > 0.9 and np.max(rounds) <= 4


@pytest.mark.parametrize("fate", ["another closes", "one lets go", "one is pulled away faster than its loss pushes"])
def test_all_else_is_left_to_the_general_solve(fate):
    (law, compliance, s, g), _, _ = chosen(5)
    if fate == "another closes":
        s[-1], g[-1] = -1e-9, 1e-3
    elif fate == "one lets go":
        g[0] = -2.0 * s[0]
    else:
        law.loss_rate[0], g[0] = 10.0 / s[0], -0.2 * s[0]
    assert solved(law, compliance, s, g)[0] == 0
