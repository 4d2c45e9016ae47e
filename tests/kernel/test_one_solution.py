"""All contact solvers find the same forces and steps: of one contact, of several, and of those that persist.
That these are on the laws is tested against fifty digits elsewhere (test_solve.py, test_many_points.py).
"""

import numpy as np
import pytest
from worst_case_solves import lossy_law

from engine.assembly.initial_state import allocate_scratch
from engine.compiler.decorators import kernel
from engine.kernel.contact.coupled_contact_solver import NO_CAP, CoupledProblem, solve_coupled
from engine.kernel.contact.law import solve_alone, step_start
from engine.kernel.contact.persistent_contact_solver import solve_persistent
from engine.kernel.contact.scalar_contact_solver import ContactEquation
from engine.kernel.data.enums import Row, SolveStatus
from engine.kernel.data.state import Scratch

pytestmark = pytest.mark.hard
PROBLEMS = 400
TOLERANCE = 1e-15  # of the solvers


@kernel
def scalar(law, compliance, s, g, found):
    equation = ContactEquation(law, 0, step_start(law, 0, s[0]), g[0], compliance[0], TOLERANCE)
    eta, _, force, _, _, status = solve_alone(equation, 0.0)
    found[0], found[1] = eta, force
    return status


@kernel
def persistent(law, compliance, s, g, scratch):
    return solve_persistent(CoupledProblem(law, compliance, s, g, TOLERANCE, scratch))


@kernel
def coupled(law, compliance, s, g, scratch, budget):
    return solve_coupled(CoupledProblem(law, compliance, s, g, TOLERANCE, scratch), NO_CAP, budget)[1]


class Problem:
    """Contacts whose bodies move by B = U·Uᵀ; the equations are η + B·f = g, f of the laws."""

    def __init__(self, seed: int, contacts: int | None = None) -> None:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 9)) if contacts is None else contacts
        self.u = rng.normal(size=(n, int(rng.integers(1, 6)))) * 10 ** rng.uniform(-5, -3)
        self.compliance = self.u @ self.u.T
        self.exponent = rng.choice([1.0, 1.3, 1.5, 2.0, 2.5, 3.0, 8.0], n)
        size = 10 ** rng.uniform(-6, -3)
        stiffness = 10 ** rng.uniform(-2, 3, n) / (np.diag(self.compliance) * size ** (self.exponent - 1))
        self.loss_rate = rng.choice([0.0, 1.0], n) * 10 ** rng.uniform(-2, 0) / size
        self.law = lossy_law(stiffness / (self.exponent + 1), self.exponent, self.loss_rate)
        self.s = size * rng.uniform(-1.0, 1.0, n)
        self.g = size * rng.normal(size=n) * 10 ** rng.uniform(-3, 0.5)

    def scratch(self) -> Scratch:
        """Memory of a solver, without a guess."""
        return Scratch(*(array[0] for array in allocate_scratch(1, self.s.size)))

    def by_coupled(self) -> tuple[np.ndarray, np.ndarray]:
        """Forces and steps of all contacts together."""
        scratch = self.scratch()
        status = coupled(self.law, self.compliance.ravel(), self.s, self.g, scratch, np.zeros(1, np.int64))
        assert status not in (SolveStatus.FAILED, SolveStatus.CAPPED)
        return self.found(scratch)

    def by_persistent(self) -> tuple[np.ndarray, np.ndarray] | None:
        """The same of contacts that persist; None if they are not known to."""
        scratch = self.scratch()
        rounds = persistent(self.law, self.compliance.ravel(), self.s, self.g, scratch)
        return self.found(scratch) if rounds > 0 else None

    def found(self, scratch: Scratch) -> tuple[np.ndarray, np.ndarray]:
        """Forces and steps."""
        n = self.s.size
        return scratch.vectors[Row.FORCE, :n].copy(), scratch.vectors[Row.STEP, :n].copy()

    def by_scalar(self) -> tuple[np.ndarray, np.ndarray]:
        """The same of the only contact."""
        found = np.zeros(2)
        scalar(self.law, self.compliance.ravel(), self.s, self.g, found)
        return found[1:], found[:1]

    def difference(self, one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
        """Return how far two solutions differ, in units of what rounding of the compressions makes of the forces."""
        (force, step), (other_force, other_step) = one, other
        moves = np.abs(self.g) + np.abs(self.compliance) @ np.abs(force)
        depth = np.abs(self.s) + moves
        hardness = self.law.elastic.potential_coefficient * (self.exponent + 1) * self.exponent
        slope = hardness * np.maximum(self.s + np.maximum(step, 0.0), 0.0) ** (self.exponent - 1)
        slope = slope * (1.0 + self.loss_rate * depth) + self.loss_rate * np.abs(force)
        rounding = 1e-16 * (np.abs(force) + slope * depth)
        forces = np.where(force == other_force, 0.0, np.abs(force - other_force) / np.maximum(rounding, 1e-300))
        return float(max(forces.max(), np.max(np.abs(step - other_step) / (1e-16 * depth))))


def test_a_contact_alone_is_solved_as_one_of_several():
    for problem in (Problem(seed, contacts=1) for seed in range(PROBLEMS)):
        assert problem.difference(problem.by_scalar(), problem.by_coupled()) <= 4.0


def test_contacts_that_persist_are_solved_as_any_others():
    found = 0
    for seed in range(PROBLEMS):
        problem = Problem(seed)
        solution = problem.by_persistent()
        if solution is not None:
            found += 1
            assert problem.difference(solution, problem.by_coupled()) <= 10.0, seed
    assert found > PROBLEMS // 10
