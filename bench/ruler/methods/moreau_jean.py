"""Moreau-Jean: rigid contacts, as impulses that keep velocities from closing what is closed.

Sources: Issanchou, Acary, Pérignon, Touzé & Le Carrou, "Nonsmooth contact dynamics for the numerical simulation of
collisions in musical string instruments" (2018), whose modes move by the exact recurrence of Bilbao (2009), with
q₊ = q + h·v₊; and for θ = 1/2 the scheme of Moreau (1988) and Jean (1999), with q₊ = q + h·(v + v₊)/2. The recurrence,
the law of contact and the rule that activates it were checked against the authors' program Siconos, its page on the
exact scheme and its integrator for it:

    v₊ = v_free + W⁻¹·(-Φᵀ·impulse);  contact k is active if barrier - Φ·q - h/2·Φ·v ≤ 0 at the step's beginning;
    for active contacts  0 ≤ impulse ⊥ -Φ·v₊ - e·Φ·v ≥ 0          (Newton's law of restitution e)

Choices: the linear complementarity problem is solved exactly by block principal pivoting (Júdice & Pires, 1994), which
falls back to one index at a time (Murty, 1974), from the last step's contacts; projected Gauss-Seidel would leave an
error where contacts are close to each other. Stiffness, exponent and loss of the contacts are not used: a soft contact
is an error of the model, not of the scheme. The modes are linear: not made for bodies that stretch, nor for friction.
Force = impulse/h. With the exact recurrence, v is (q - q₋)/h; p at a sample is the exact one where there is no contact,
and has half of an impulse (exact_velocity_rule). With θ = 1/2, p is v before the impulse.
"""

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods.common import (
    add_forces,
    copy,
    coupling,
    exact_flow,
    exact_recurrence,
    has_more_than_contacts,
    keep,
    kernel,
    not_applicable,
    project,
    push,
    run_kernel,
    solve_linear,
)
from bench.ruler.methods.fdn import VelocityRule, exact_velocity_rule

REGULARISED = 1e-13  # of the mean diagonal: contacts at almost one place have almost equal rows


@kernel
def find_impulses(matrix, rate, active, held, impulse, gap_rate, square, right, index):
    """Fill impulse [contacts] such that 0 ≤ impulse ⊥ rate + matrix·impulse ≥ 0 for the active contacts.

    matrix: [contacts, contacts], symmetric and positive; rate: [contacts], m/s
    held: [contacts], which impulses are positive: where to begin, and what was found
    """
    contacts = rate.shape[0]
    size, trace = 0.0, 0.0
    for k in range(contacts):
        held[k] = held[k] and active[k]
        size = max(size, abs(rate[k]))
        trace += matrix[k, k]
    least, patience = contacts + 1, 3
    for _ in range(100 * contacts):
        n = 0
        for k in range(contacts):
            impulse[k] = 0.0
            if held[k]:
                index[n] = k
                n += 1
        for i in range(n):
            for j in range(n):
                square[i, j] = matrix[index[i], index[j]]
            square[i, i] += REGULARISED * trace / contacts
            right[i] = -rate[index[i]]
        solve_linear(square, right, n)
        for i in range(n):
            impulse[index[i]] = right[i]
        wrong, first = 0, -1
        for k in range(contacts):
            if not active[k]:
                continue
            gap_rate[k] = rate[k]
            for i in range(n):
                gap_rate[k] += matrix[k, index[i]] * right[i]
            if (held[k] and impulse[k] < 0.0) or (not held[k] and gap_rate[k] < -1e-12 * size):
                wrong += 1
                first = k if first < 0 else first
        if wrong == 0:
            return
        if wrong < least:
            least, patience = wrong, 3
        else:
            patience -= 1
        for k in range(contacts):  # all wrong ones at once, while that helps; else the first
            if active[k] and (patience > 0 or k == first):
                if (held[k] and impulse[k] < 0.0) or (not held[k] and gap_rate[k] < -1e-12 * size):
                    held[k] = not held[k]
    for k in range(contacts):
        impulse[k] = max(0.0, impulse[k])


@kernel
def step_rigidly(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Moreau-Jean. tables: v₊ = by_q·q + by_v·v + by_weight; 1/W [modes]; Φ·W⁻¹·Φᵀ; v at the start; the shares of v₊
    and v in q₊ = q + h·(late·v₊ + early·v); the rule for p; restitution e."""
    by_q, by_v, by_weight, inverse, matrix, start, shares, rule, restitution = tables
    late, early = shares
    modes, contacts = q.shape[0], force.shape[1]
    v, following = work.modal[0], work.modal[1]
    copy(start, v)
    rate, impulse, gap_rate, right = work.contact[0], work.contact[1], work.contact[2], work.contact[3]
    active, held = work.marks[0], work.marks[1]
    keep(0, system, q, p, displacement, q_out, p_out)
    for step in range(force.shape[0] * steps + 1):  # one more, for the last velocity
        closed = False
        for k in range(contacts):
            gap, closing = system.barrier[k] - project(system.shapes, k, q), project(system.shapes, k, v)
            active[k] = gap - 0.5 * h * closing <= 0.0
            rate[k] = -restitution * closing
            closed |= active[k]
        for m in range(modes):
            following[m] = by_q[m] * q[m] + by_v[m] * v[m] + by_weight[m]
        if q_out.shape[0] > 0 and step > 0 and step % steps == 0:
            for m in range(modes):
                p[m] = v[m]
                if early == 0.0:  # the exact recurrence, of which v and v₊ are differences
                    change = h * (following[m] + v[m])
                    p[m] = rule.scale[m] * (change - rule.in_place[m] * q[m] - rule.pushed[m])
        impulse[:] = 0.0
        if closed:
            for k in range(contacts):
                if active[k]:
                    rate[k] -= project(system.shapes, k, following)
            find_impulses(matrix, rate, active, held, impulse, gap_rate, work.square, right, work.index)
            push(system, impulse, inverse, following)
        frame = step // steps
        if step > 0 and step % steps == 0:
            if closed:
                push(system, impulse, rule.struck, p)
            keep(frame, system, q, p, displacement, q_out, p_out)
        if frame < force.shape[0]:
            if step % steps == 0:
                force[frame] = 0.0
            if closed:
                add_forces(impulse, 1.0 / (h * steps), force, frame)
        for m in range(modes):
            q[m] += h * (late * following[m] + early * v[m])
        v, following = following, v


def simulate_modal(problem: Problem, steps: int, restitution: float) -> Trajectory:
    """Simulate by Moreau-Jean with the linear part exact, in `steps` time steps per sample."""
    if has_more_than_contacts(problem):
        return not_applicable(problem)
    h = 1.0 / (problem.samplerate * steps)
    a, e, b = exact_recurrence(problem, h)
    back = exact_flow(problem, -h)
    v = (problem.q - (back.qq * problem.q + back.qp * problem.p + back.qw)) / h
    inverse = b / (h * h)
    tables = (-(1.0 + e - a) / h, e, b / h * problem.weight, inverse, coupling(problem, inverse), v)
    rule = exact_velocity_rule(problem, h)
    return run_kernel(step_rigidly, problem, steps, (*tables, (1.0, 0.0), rule, restitution))


def simulate_theta(problem: Problem, steps: int, restitution: float) -> Trajectory:
    """Simulate by Moreau-Jean with θ = 1/2, in `steps` time steps per sample."""
    if has_more_than_contacts(problem):
        return not_applicable(problem)
    h, omega2, sigma = 1.0 / (problem.samplerate * steps), problem.omega**2, problem.sigma
    inverse = 1.0 / (1.0 + 0.25 * h * h * omega2 + h * sigma)
    by_v = 1.0 - inverse * (0.5 * h * h * omega2 + 2.0 * h * sigma)
    rule = VelocityRule(*np.zeros((4, omega2.size)))
    tables = (-inverse * h * omega2, by_v, inverse * h * problem.weight, inverse, coupling(problem, inverse), problem.p)
    return run_kernel(step_rigidly, problem, steps, (*tables, (0.5, 0.5), rule, restitution))


def simulate_elastic(problem: Problem, steps: int) -> Trajectory:
    """Simulate by Moreau-Jean, linear part exact, restitution 1."""
    return simulate_modal(problem, steps, 1.0)


def simulate_inelastic(problem: Problem, steps: int) -> Trajectory:
    """Simulate by Moreau-Jean, linear part exact, restitution 0."""
    return simulate_modal(problem, steps, 0.0)


def simulate_theta_elastic(problem: Problem, steps: int) -> Trajectory:
    """Simulate by Moreau-Jean, θ = 1/2, restitution 1."""
    return simulate_theta(problem, steps, 1.0)


def simulate_theta_inelastic(problem: Problem, steps: int) -> Trajectory:
    """Simulate by Moreau-Jean, θ = 1/2, restitution 0."""
    return simulate_theta(problem, steps, 0.0)
