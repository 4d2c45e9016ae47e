"""FDN: Newton's second law by finite differences, with the contact's force averaged over the neighbouring steps.

Source: Chatziioannou & van Walstijn, "An energy conserving finite difference scheme for simulation of collisions"
(SMC 2013), equation 4, after Bilbao, Numerical Sound Synthesis (2009):

    (y₊ - 2y + y₋)/h² + stiffness·[y]₊^(α-1)·(y₊ + y₋)/2 = 0       (α = 3 as printed; α = 1: one where y > 0)

The authors give it for α = 1 and 3 only, and say that nothing firm holds for others; their sequels ("Energy conserving
schemes for the simulation of musical instrument contact dynamics", 2015; Bilbao, Torin & Chatziioannou, "Numerical
modeling of collisions in musical instruments", 2015) leave it for schemes of other kinds. With any other exponent it is
not applicable here (bench.ruler.methods.common.not_applicable).

Generalised here to modes and contacts: y is the compression of a contact, not cut off at zero in the average, and the
forces of all closed contacts follow from one linear system per step. Losses, which the paper's equation lacks, are
centred differences: of the modes, and of the contacts as stiffness·[s]₊^α·loss·(s₊ - s₋)/2h, never below zero in sum.
Two variants: the modes explicit, as the paper's authors would have them (unstable where ωh > 2), and the modes' exact
recurrence of Issanchou, Bilbao, Le Carrou, Touzé & Doaré (2017). The first step is Taylor's, or the exact motion.

p is the centred difference (q₊ - q₋)/2h; with the exact recurrence, the exact one where there is no contact.
"""

from typing import NamedTuple

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods.common import (
    add_forces,
    copy,
    coupling,
    exact_flow,
    exact_recurrence,
    find_compressions,
    has_more_than_contacts,
    keep,
    kernel,
    not_applicable,
    power,
    push,
    run_kernel,
    solve_linear,
)


class VelocityRule(NamedTuple):
    """How p follows from three steps: p = scale·(q₊ - q₋ - in_place·q - pushed) - struck·Φᵀ·impulse, with the q₊ that
    the step would have without the contacts' impulse; [modes] each."""

    scale: np.ndarray
    in_place: np.ndarray
    pushed: np.ndarray
    struck: np.ndarray


def exact_velocity_rule(problem: Problem, h: float) -> VelocityRule:
    """The rule for an exact recurrence: p is exact without contact, and has half of an impulse at its step.

    Where a step is near half a period of a mode, q₊ - q₋ says too little, and p is the centred difference.
    """
    ahead, back = exact_flow(problem, h), exact_flow(problem, -h)
    seen = ahead.qp - back.qp
    known = np.abs(seen) > 0.2 * h
    return VelocityRule(
        scale=np.where(known, 1.0 / np.where(known, seen, 1.0), 0.5 / h),
        in_place=np.where(known, ahead.qq - back.qq, 0.0),
        pushed=np.where(known, ahead.qw - back.qw, 0.0),
        struck=np.where(known, 0.5, 0.5 * exact_recurrence(problem, h)[2] / h**2),
    )


@kernel
def find_averaged_forces(system, matrix, h, s, before, free, f, square, right, closed):
    """Fill f [contacts], N, from the compressions s, `before` and `free`, that of the next step without any force.

    f = stiffness·([s]₊^(α-1)·(s₊ + s₋)/2 + loss·[s]₊^α·(s₊ - s₋)/2h), s₊ = free - matrix·f
    """
    contacts = s.shape[0]
    n = 0
    for k in range(contacts):
        f[k] = 0.0
        if s[k] > 0.0:
            closed[n] = k
            n += 1
    for i in range(n):
        k = closed[i]
        average = 0.5 * system.stiffness[k] * power(s[k], system.exponent[k] - 1.0)
        slowing = average * s[k] * system.loss[k] / h
        right[i] = (average + slowing) * free[k] + (average - slowing) * before[k]
        for j in range(n):
            square[i, j] = (average + slowing) * matrix[k, closed[j]]
        square[i, i] += 1.0
    solve_linear(square, right, n)
    for i in range(n):
        k = closed[i]
        f[k] = right[i] if system.loss[k] == 0.0 else max(0.0, right[i])


@kernel
def step_averaging(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """FDN. tables: a, e, b of the recurrence q₊ = a·q - e·q₋ + b·force; q at -h; Φ·b·Φᵀ; the rule for p."""
    a, e, b, before_start, matrix, rule = tables
    previous = work.modal[1]
    copy(before_start, previous)
    modes = q.shape[0]
    s, before, free, f = work.contact[0], work.contact[1], work.contact[2], work.contact[3]
    right, following = work.contact[4], work.modal[0]
    keep(0, system, q, p, displacement, q_out, p_out)
    find_compressions(system, previous, before)
    touching = find_compressions(system, q, s)
    for step in range(force.shape[0] * steps + 1):  # one more, for the last velocity
        for m in range(modes):
            following[m] = a[m] * q[m] - e[m] * previous[m] + b[m] * system.weight[m]
        if q_out.shape[0] > 0 and step > 0 and step % steps == 0:
            for m in range(modes):
                change = following[m] - previous[m] - rule.in_place[m] * q[m] - rule.pushed[m]
                p[m] = rule.scale[m] * change
        if touching:
            find_compressions(system, following, free)
            find_averaged_forces(system, matrix, h, s, before, free, f, work.square, right, work.index)
            push(system, f, b, following)
        else:
            f[:] = 0.0
        frame = step // steps
        if step > 0 and step % steps == 0:
            if touching:
                for k in range(f.shape[0]):
                    f[k] *= h
                push(system, f, rule.struck, p)
                for k in range(f.shape[0]):
                    f[k] /= h
            keep(frame, system, q, p, displacement, q_out, p_out)
        if frame < force.shape[0]:
            if step % steps == 0:
                force[frame] = 0.0
            if touching:
                add_forces(f, 1.0 / steps, force, frame)
        before, s = s, before
        touching = find_compressions(system, following, s)
        previous, q, following = q, following, previous


def starting_pull(problem: Problem) -> np.ndarray:
    """What the contacts do to each mode at the start, -Φᵀ·f [modes], √kg·m/s²."""
    s = np.maximum(problem.shapes @ problem.q - problem.barrier, 0.0)
    rate = np.maximum(1.0 + problem.loss * (problem.shapes @ problem.p), 0.0)
    return np.asarray(-problem.shapes.T @ (problem.stiffness * s**problem.exponent * rate))


def is_printed(problem: Problem) -> bool:
    """True if the authors give the scheme for all exponents of a problem, and it has contacts alone."""
    return not has_more_than_contacts(problem) and bool(np.all(np.isin(problem.exponent, (1.0, 3.0))))


def simulate_fdn(problem: Problem, steps: int) -> Trajectory:
    """Simulate by FDN, in `steps` time steps per sample."""
    if not is_printed(problem):
        return not_applicable(problem)
    h = 1.0 / (problem.samplerate * steps)
    lost = 1.0 + problem.sigma * h
    a, e, b = (2.0 - (problem.omega * h) ** 2) / lost, (2.0 - lost) / lost, h * h / lost
    acceleration = problem.weight - problem.omega**2 * problem.q - 2.0 * problem.sigma * problem.p
    previous = problem.q - h * problem.p + 0.5 * h * h * (acceleration + starting_pull(problem))
    nothing = np.zeros(problem.omega.size)
    rule = VelocityRule(nothing + 0.5 / h, nothing, nothing, 0.5 * b / h**2)
    return run_kernel(step_averaging, problem, steps, (a, e, b, previous, coupling(problem, b), rule))


def simulate_fdn_exact(problem: Problem, steps: int) -> Trajectory:
    """Simulate by FDN with the linear part exact, in `steps` time steps per sample."""
    if not is_printed(problem):
        return not_applicable(problem)
    h = 1.0 / (problem.samplerate * steps)
    a, e, b = exact_recurrence(problem, h)
    back = exact_flow(problem, -h)
    previous = back.qq * problem.q + back.qp * problem.p + back.qw + 0.5 * b * starting_pull(problem)
    tables = (a, e, b, previous, coupling(problem, b), exact_velocity_rule(problem, h))
    return run_kernel(step_averaging, problem, steps, tables)
