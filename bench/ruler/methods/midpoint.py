"""The implicit midpoint rule on the full system.

Source: the Gauss method of one stage (Hairer, Lubich & Wanner, Geometric Numerical Integration, section II.1); all
terms, the modes' linear ones included, are taken at the middle of the step, so that nothing limits the step but the
loss of accuracy of the modes' frequencies.

The modes are linear, so that a step comes down to one unknown per contact, its compression x in the middle:

    x + h²/4·Φ·D·Φᵀ·f(x) = s_free,   D = 1/(1 + σh + ω²h²/4),   f = stiffness·[x]₊^α·max(0, 1 + loss·2(x - s)/h)

Choices: Newton's method on the closed contacts, from the compressions of the last step, shortened until the residual
falls; should it not converge, contact by contact (each a scalar equation that rises strictly, between bounds), which
descends a convex function and always does. For a given tension of a body that stretches the modes are linear as well;
the tension and the rest are found in turn.
"""

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods.common import (
    add_forces,
    copy,
    coupling,
    find_compressions,
    inline,
    keep,
    kernel,
    not_applicable,
    power,
    project,
    push,
    run_kernel,
    solve_linear,
)

ACCURACY = 1e-14  # of a compression, relative to the largest; of the tension of a body that stretches
MOST_TURNS = 100  # between the tension and the rest


@inline
def find_force(system, k, x, start, h):
    """Force of contact k, N, and its slope, N/m, at the middle compression x of a step that began at `start`, m."""
    if x <= 0.0:
        return 0.0, 0.0
    softer = power(x, system.exponent[k] - 1.0)
    slowing = 1.0 + system.loss[k] * 2.0 * (x - start) / h
    if slowing <= 0.0:
        return 0.0, 0.0
    stiffness = system.stiffness[k] * softer
    return stiffness * x * slowing, stiffness * (system.exponent[k] * slowing + x * system.loss[k] * 2.0 / h)


@kernel
def find_residual(system, matrix, free, start, h, x, f, slope, residual):
    """Fill f, slope and residual [contacts] at compressions x; returns the largest residual, m."""
    contacts = x.shape[0]
    for k in range(contacts):
        f[k], slope[k] = find_force(system, k, x[k], start[k], h)
        residual[k] = x[k] - free[k]
    for k in range(contacts):
        if f[k] != 0.0:
            for other in range(contacts):
                residual[other] += matrix[other, k] * f[k]
    largest = 0.0
    for k in range(contacts):
        largest = max(largest, abs(residual[k]))
    return largest


@kernel
def solve_one(system, weight, k, free, start, h, x):
    """The compression, m, for which x + weight·force = free; Newton's method between bounds, from x."""
    low, high = min(free, 0.0), max(free, 0.0)
    if free <= 0.0:
        return free
    x = min(max(x, low), high)
    for _ in range(200):
        f, slope = find_force(system, k, x, start, h)
        residual = x + weight * f - free
        if residual > 0.0:
            high = x
        else:
            low = x
        better = x - residual / (1.0 + weight * slope)
        if not (low <= better <= high):
            better = 0.5 * (low + high)
        if not abs(better - x) > 0.1 * ACCURACY * free:  # also if it is not a number
            return better
        x = better
    return x


@kernel
def solve_one_by_one(system, matrix, free, start, h, x, f):
    """Solve for the compressions x contact by contact, again and again until they agree."""
    contacts = x.shape[0]
    for k in range(contacts):
        f[k] = find_force(system, k, x[k], start[k], h)[0]
    for _ in range(10000):
        change, largest = 0.0, 0.0
        for k in range(contacts):
            alone = free[k]
            for other in range(contacts):
                if other != k:
                    alone -= matrix[k, other] * f[other]
            root = solve_one(system, matrix[k, k], k, alone, start[k], h, x[k])
            change, largest = max(change, abs(root - x[k])), max(largest, abs(root))
            x[k] = root
            f[k] = find_force(system, k, root, start[k], h)[0]
        if not change > ACCURACY * largest:
            return


@kernel
def solve_together(system, matrix, free, start, h, x, f, work):
    """Newton's method for the compressions x [contacts] and forces f; returns whether it converged.

    work: of which contact[4:9], square and index are overwritten
    """
    contacts = x.shape[0]
    room, square, closed = work.contact, work.square, work.index
    slope, residual, trial, step, right = room[4], room[5], room[6], room[7], room[8]
    scale = 0.0
    for k in range(contacts):
        scale = max(scale, abs(free[k]), abs(start[k]))
    error = find_residual(system, matrix, free, start, h, x, f, slope, residual)
    for _ in range(60):
        if not error > ACCURACY * scale:
            return True
        n = 0
        for k in range(contacts):
            if slope[k] > 0.0:
                closed[n] = k
                n += 1
        for i in range(n):  # only closed contacts change the others
            for j in range(n):
                square[i, j] = matrix[closed[i], closed[j]] * slope[closed[j]]
            square[i, i] += 1.0
            right[i] = -residual[closed[i]]
        solve_linear(square, right, n)
        for k in range(contacts):
            step[k] = -residual[k]
            for j in range(n):
                step[k] -= matrix[k, closed[j]] * slope[closed[j]] * right[j]
        length, before = 1.0, error
        for _ in range(30):
            for k in range(contacts):
                trial[k] = x[k] + length * step[k]
            error = find_residual(system, matrix, free, start, h, trial, f, slope, residual)
            if error < before:
                break
            length *= 0.5
        if not error < before:  # no better: at the limit of rounding, or lost
            find_residual(system, matrix, free, start, h, x, f, slope, residual)
            return before <= 100.0 * ACCURACY * scale
        copy(trial, x)
    return False


@inline
def solve_middle(system, tables, work, h, q, p, middle):
    """Find the momenta in the middle of a step, its compressions and forces; returns whether anything may touch."""
    softened, kick, matrix, tension = tables
    start, free, x, f = work.contact[0], work.contact[1], work.contact[2], work.contact[3]
    modes, contacts = q.shape[0], x.shape[0]
    for m in range(modes):
        pull = system.weight[m] - (system.omega2[m] + tension[m]) * q[m]
        middle[m] = softened[m] * (p[m] + 0.5 * h * pull)
    touching = False
    for k in range(contacts):
        free[k] = start[k] + 0.5 * h * project(system.shapes, k, middle)
        touching |= not free[k] <= 0.0
    if touching:
        if contacts == 1:
            x[0] = solve_one(system, matrix[0, 0], 0, free[0], start[0], h, x[0])
            f[0] = find_force(system, 0, x[0], start[0], h)[0]
        elif not solve_together(system, matrix, free, start, h, x, f, work):
            solve_one_by_one(system, matrix, free, start, h, x, f)
        push(system, f, kick, middle)
    else:
        copy(free, x)
    return touching


@kernel
def soften(system, tables, rise, h):
    """Fill the tables for a rise of each body that stretches: r of the middle [bodies]."""
    softened, kick, matrix, tension = tables
    modes, contacts = softened.shape[0], matrix.shape[0]
    for m in range(modes):
        tension[m] = 0.0
        for b in range(rise.shape[0]):
            tension[m] += rise[b] * system.stretch[b, m]
        softened[m] = 1.0 / (1.0 + system.sigma[m] * h + 0.25 * h * h * (system.omega2[m] + tension[m]))
        kick[m] = 0.5 * h * softened[m]
    for k in range(contacts):
        for other in range(k + 1):
            total = 0.0
            for m in range(modes):
                total += system.shapes[k, m] * softened[m] * system.shapes[other, m]
            matrix[k, other] = matrix[other, k] = 0.25 * h * h * total


@kernel
def find_rises(system, q, middle, h, rise):
    """Set the rises to those of the middle, q + h/2·middle; returns the largest change, relative."""
    largest = 0.0
    for b in range(rise.shape[0]):
        total = 0.0
        for m in range(q.shape[0]):
            there = q[m] + 0.5 * h * middle[m]
            total += system.stretch[b, m] * there * there
        largest = max(largest, abs(total - rise[b]) / max(total, 1e-300))
        rise[b] = total
    return largest


@kernel
def step_implicitly(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Implicit midpoint rule; tables: those of solve_middle, and r of each body that stretches."""
    tables, rise = tables
    modes, contacts = q.shape[0], force.shape[1]
    start, x, f = work.contact[0], work.contact[2], work.contact[3]
    middle = work.modal[0]
    keep(0, system, q, p, displacement, q_out, p_out)
    find_compressions(system, q, start)
    copy(start, x)
    for frame in range(force.shape[0]):
        force[frame] = 0.0
        for _ in range(steps):
            if rise.shape[0] == 0:
                touching = solve_middle(system, tables, work, h, q, p, middle)
            else:
                for _turn in range(MOST_TURNS):
                    soften(system, tables, rise, h)
                    touching = solve_middle(system, tables, work, h, q, p, middle)
                    if not find_rises(system, q, middle, h, rise) > ACCURACY:
                        break
            if touching:
                add_forces(f, 1.0 / steps, force, frame)
            for m in range(modes):
                q[m] += h * middle[m]
                p[m] = 2.0 * middle[m] - p[m]
            for k in range(contacts):  # the middle is the mean of both ends
                start[k] = 2.0 * x[k] - start[k]
        find_compressions(system, q, start)  # so that rounding does not add up
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


def simulate_midpoint(problem: Problem, steps: int) -> Trajectory:
    """Simulate by the implicit midpoint rule, in `steps` time steps per sample."""
    if problem.friction is not None:
        return not_applicable(problem)
    h = 1.0 / (problem.samplerate * steps)
    softened = 1.0 / (1.0 + problem.sigma * h + 0.25 * (problem.omega * h) ** 2)
    tables = (softened, 0.5 * h * softened, 0.25 * h * h * coupling(problem, softened), np.zeros(softened.size))
    rise = np.zeros(0 if problem.stretch is None else len(problem.stretch))
    return run_kernel(step_implicitly, problem, steps, (tables, rise))
