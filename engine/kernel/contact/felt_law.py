"""The law of felt with memory: a power law of which a share relaxes (docs/design.md, "Felt with memory").

    F = (1 - ε)·f(u) + ε·f(u - z),    z' = (u₊ - z)/T

The second branch stands on a dashpot, which has crept by z: it takes ε·f(u - z)·z' ≥ 0 of the energy, so that fast
blows find the whole stiffness, slow ones (1 - ε) of it, and one that follows soon finds felt that has not come back.
Where the branch is open, its way back takes nothing. Over a step of length h, with e = u - z, r = h/T and the mean
e + θ·Δe,

    ζ = Δz = r·(e + θ·η)/(1 + θ·r),    θ = max(½, 1 - 1/r),

if that is not negative. So z follows from η, and the force of both branches never falls with it: one solution. Stulov's
felt (1995) has F = F0·[u^p - ε·w], τ·w' = u^p - w, which is not passive; T = p·τ gives the branch the same relaxation
of its force.
"""

from engine.compiler.decorators import inline, noinline
from engine.compiler.elementary import expm1_of
from engine.kernel.contact.power_law import (
    elastic_law,
    potential,
    potential_difference,
    respond_by_power_law,
    store_power_law,
)
from engine.kernel.contact.scalar_contact_solver import solve_power_law
from engine.kernel.data.effects import EFFECTS, RELAXATION
from engine.kernel.data.enums import SolveStatus
from engine.kernel.data.felt_numbers import FeltNumber

MAX_EVALUATIONS = 100  # bisection alone would be done by then
SAME = 1e-15  # share by which ends differ that are the same but for rounding
NO_CREEP = 1e-15  # m: what is left of z counts as nothing


@inline
def relaxes(law_numbers, k):
    """True if contact k is felt with memory."""
    if EFFECTS & RELAXATION:
        return law_numbers[k][FeltNumber.SHARE] > 0.0
    return False


@inline
def recover_all(state, time, length):
    """Let felt that is not pressed come back until a time, at which a step begins, or a change (length 0), frames."""
    if EFFECTS & RELAXATION:
        for k in range(state.compression.shape[0]):
            felt = state.law_numbers[k]
            if felt[FeltNumber.CREPT] > 0.0 and time > felt[FeltNumber.TIME]:
                felt[FeltNumber.CREPT] *= 1.0 + expm1_of(-felt[FeltNumber.RATE] * (time - felt[FeltNumber.TIME]))
                if felt[FeltNumber.CREPT] < NO_CREEP:
                    felt[FeltNumber.CREPT] = 0.0
            felt[FeltNumber.TIME], felt[FeltNumber.LENGTH] = time, length


@inline
def creep_in_step(felt, s, eta):
    """Return how far the branch that relaxes creeps in a step, ζ in m, and its slope dζ/dη. s: compression at the begin
    of the step; eta: how it changes, m"""
    turn = felt[FeltNumber.RATE] * felt[FeltNumber.LENGTH]
    e, share = s - felt[FeltNumber.CREPT], max(0.5, 1.0 - 1.0 / turn)
    slope = turn * share / (1.0 + share * turn)
    creep = turn * (e + share * eta) / (1.0 + share * turn)
    if creep >= 0.0:
        return creep, slope
    if e > 0.0 or e + eta > 0.0:
        return 0.0, 0.0
    mean = 0.5 * (max(s, 0.0) + max(s + eta, 0.0))
    return max((felt[FeltNumber.CREPT] - mean) * expm1_of(-turn), e + eta), 0.0  # the branch stays open


@inline
def respond_by_felt(laws, k, s, eta):
    """Return the mean force and slope df/dη of felt for a step η."""
    felt = laws.law_numbers[k]
    share = felt[FeltNumber.SHARE]
    creep, creep_slope = creep_in_step(felt, s, eta)
    f, df = respond_by_power_law(laws, k, s, eta)
    fast, slope = respond_by_power_law(laws, k, s - felt[FeltNumber.CREPT], eta - creep)
    return (1.0 - share) * f + share * fast, (1.0 - share) * df + share * slope * (1.0 - creep_slope)


@noinline
def solve_felt(equation):
    """Solve the ContactEquation of felt, by Newton's method within a bracket. Result: as of
    engine.kernel.contact.law.solve_alone"""
    laws, k, start, g, compliance, _ = equation
    s = start.s
    if s <= 0.0 and s + g <= 0.0:
        return g, s + g, 0.0, 0.0, 0, SolveStatus.FREE
    low, high = g - compliance * respond_by_felt(laws, k, s, g)[0], g
    eta = min(max(solve_power_law(equation, 0.0)[0], low), high)  # that of felt which does not relax
    for evaluations in range(1, MAX_EVALUATIONS + 1):
        f, slope = respond_by_felt(laws, k, s, eta)
        residual = (eta - g) + compliance * f
        if residual > 0.0:
            high = eta
        else:
            low = eta
        step = -residual / (1.0 + compliance * slope)
        if not (low <= eta + step and eta + step <= high):
            step = 0.5 * (low + high) - eta
        eta += step
        if abs(step) <= SAME * (abs(s) + abs(eta)):
            return eta, s + eta, max(0.0, f + slope * step), slope, evaluations, SolveStatus.NEWTON
    return eta, s + eta, 0.0, 0.0, MAX_EVALUATIONS, SolveStatus.FAILED


@inline
def store_felt(laws, state, k, solution, residual):
    """Store the new compression, force and creep of felt. Returns the energy that its dashpot takes, J. solution,
    residual: as of engine.kernel.contact.law.store_solution"""
    felt, s = state.law_numbers[k], state.compression[k]
    creep, _ = creep_in_step(felt, s, solution[0])
    fast, _ = respond_by_power_law(laws, k, s - felt[FeltNumber.CREPT], solution[0] - creep)
    lost = store_power_law(laws, state, k, solution, residual)
    felt[FeltNumber.CREPT] += creep
    felt[FeltNumber.LAST] = creep
    felt[FeltNumber.TIME] += felt[FeltNumber.LENGTH]
    return lost + felt[FeltNumber.SHARE] * fast * creep


@inline
def energy_of_felt(state, k):
    """Return the energy that both branches hold, J."""
    felt, law, s = state.law_numbers[k], elastic_law(state), state.compression[k]
    share = felt[FeltNumber.SHARE]
    return (1.0 - share) * potential(law, k, s) + share * potential(law, k, s - felt[FeltNumber.CREPT])


@inline
def energy_gained_by_felt(state, k, s):
    """Return the energy that both branches have gained in the step since the compression was s, J."""
    felt, law, end = state.law_numbers[k], elastic_law(state), state.compression[k]
    share, crept = felt[FeltNumber.SHARE], felt[FeltNumber.CREPT]
    e, fast_end = s - (crept - felt[FeltNumber.LAST]), end - crept
    gained = (1.0 - share) * potential_difference(law, k, s, end, end - s)
    return gained + share * potential_difference(law, k, e, fast_end, fast_end - e)
