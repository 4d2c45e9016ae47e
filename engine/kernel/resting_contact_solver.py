"""The contact solve of contacts that stay closed, as of a string pressed on a fret: plain Newton steps.

Bodies at rest on each other move little in a step, and the step itself, η = 0, is near the solution: two evaluations of
each law are enough, where the coupled solve (engine.kernel.coupled_contact_solver) takes nine.
"""

from engine.compiler.decorators import INT64_0, noinline
from engine.kernel.codes import Row
from engine.kernel.contact_law import exponent
from engine.kernel.coupled_contact_round import dot, newton_step, try_extrapolate
from engine.kernel.coupled_contact_solver import activate, extend_active_set, scatter_solution
from engine.kernel.scalar_contact_solver import loss_rate_of, response_in_contact

MAX_RESTING_ROUNDS = 4


@noinline
def activate_closed(problem):
    """The active set of the contacts that are closed, if they are those that pushed in the step before and no other is
    in reach. Returns its size; 0 if it is not so."""
    scratch, s = problem.scratch, problem.s
    n = INT64_0
    for k in range(s.shape[0]):
        scratch.is_active[k] = 0
        if s[k] > 0.0 and scratch.vectors[Row.FORCE, k] > 0.0:
            activate(problem, n, k, scratch.vectors[Row.FORCE, k], 0.0)
            n += 1
        elif s[k] > 0.0 or s[k] + problem.g[k] > 0.0:
            return INT64_0
    return n


@noinline
def evaluate_laws(problem, n):
    """ACTIVE_FORCE and SLOPE of the active set at ACTIVE_STEP and ACTIVE_END, and RESIDUAL. Returns whether all stay
    closed."""
    vectors, near, contacts = problem.scratch.vectors, problem.scratch.active_compliance, problem.scratch.active
    s, eta, end = vectors[Row.START], vectors[Row.ACTIVE_STEP], vectors[Row.ACTIVE_END]
    f, slope, left = vectors[Row.ACTIVE_FORCE], vectors[Row.SLOPE], vectors[Row.RESIDUAL]
    for i in range(n):
        rate = loss_rate_of(problem.loss_rate, contacts[i])
        if not (end[i] > 0.0 and 1.0 + rate * eta[i] > 0.0):
            return False
        f[i], slope[i], _, _ = response_in_contact(problem.law, contacts[i], s[i], end[i], eta[i], rate)
    for i in range(n):
        left[i] = vectors[Row.FREE_MOVE, i] - dot(near[i], f, n) - eta[i]
    return True


@noinline
def try_resting_contacts(problem):
    """Solve contacts that stay closed and move little, by Newton's iteration from no step at all: one evaluation of
    each law a round. Returns rounds; 0 if something opens or closes, or the iteration takes too long."""
    if exponent(problem.law, INT64_0) == 1.0:  # solved in closed form
        return INT64_0
    n = activate_closed(problem)
    if n < 2:
        return INT64_0
    vectors = problem.scratch.vectors
    eta, end, after = vectors[Row.ACTIVE_STEP], vectors[Row.ACTIVE_END], vectors[Row.FURTHER_MOVE]
    for i in range(n):
        eta[i], end[i] = 0.0, vectors[Row.START, i]
    for rounds in range(1, MAX_RESTING_ROUNDS + 1):
        if not evaluate_laws(problem, n):
            return INT64_0
        newton_step(problem.scratch, n)
        if try_extrapolate(problem, n):
            if extend_active_set(problem, n, vectors[Row.ACTIVE_FORCE]) > n:
                return INT64_0
            scatter_solution(problem, n)
            return rounds
        for i in range(n):
            eta[i] += after[i]
            end[i] += after[i]
    return INT64_0
