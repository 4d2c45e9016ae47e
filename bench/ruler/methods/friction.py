"""Friction (bench.ruler.contact_ruler.problem) by methods of others, on problems that have no contacts.

Störmer-Verlet: half a kick by the bristles, exact motion of the modes, half a kick, as in verlet.py. The bristles bend
with the surfaces and are cut off at their bound; the bound and θ at the end of a step are solved together.

RK4, linear part exact, as in runge_kutta.py: a point is stuck or slides for a whole step; at its end, it may change.

Friction curve: McIntyre, Schumacher & Woodhouse, "On the oscillations of musical instruments" (1983), after Friedlander
(1953). The coefficient is a curve of the present speed of slip, and there is no bristle. At each step, the curve meets
the line on which the string answers to a force. Where it does so more than once, a surface stays stuck or sliding
(their rule of hysteresis). With modes: half an exact motion, the force, half an exact motion. This is another model:
the error shows how much it matters.
"""

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods.common import copy, exact_flow, inline, keep, kernel, not_applicable, project, run_kernel

MOST_TURNS = 100  # between the bound and θ
VELOCITY, FORCE, STATIC, DYNAMIC, SPEED, MEMORY, BRISTLE = range(7)  # rows of Problem.friction


@inline
def find_reach(law, k, remembered):
    """How far bristle k may bend, m."""
    share = law[SPEED, k] / (law[SPEED, k] + remembered)
    return law[FORCE, k] * (law[DYNAMIC, k] + (law[STATIC, k] - law[DYNAMIC, k]) * share) / law[BRISTLE, k]


@inline
def find_shrinking(law, k, remembered):
    """The derivative of this by θ over the memory."""
    slope = law[FORCE, k] * (law[STATIC, k] - law[DYNAMIC, k]) / law[BRISTLE, k]
    return -slope * law[SPEED, k] / (law[SPEED, k] + remembered) ** 2 / law[MEMORY, k]


@inline
def flow_ahead(flow, q, p):
    """Move free modes."""
    for m in range(q.shape[0]):
        old = q[m]
        q[m] = flow.qq[m] * old + flow.qp[m] * p[m] + flow.qw[m]
        p[m] = flow.pq[m] * old + flow.pp[m] * p[m] + flow.pw[m]


@inline
def kick(rows, k, impulse, p):
    """p -= Φ_k·impulse"""
    for m in range(p.shape[0]):
        p[m] -= impulse * rows[k, m]


@kernel
def step_verlet(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Störmer-Verlet; tables: the flow, rows, numbers of friction, and room [4, points]."""
    flow, rows, law, room = tables
    bend, remembered, before = room[0], room[1], room[2]
    points = rows.shape[0]
    for k in range(points):
        bend[k], remembered[k] = 0.0, 0.0
    keep(0, system, q, p, displacement, q_out, p_out)
    for frame in range(force.shape[0]):
        for k in range(points):
            force[frame, k] = 0.0
        for _ in range(steps):
            for k in range(points):
                kick(rows, k, 0.5 * h * law[BRISTLE, k] * bend[k], p)
                force[frame, k] += 0.5 / steps * law[BRISTLE, k] * bend[k]
                before[k] = project(rows, k, q)
            flow_ahead(flow, q, p)
            for k in range(points):
                far = bend[k] + project(rows, k, q) - before[k] - h * law[VELOCITY, k]
                forgotten = 1.0 - np.exp(-h / law[MEMORY, k])
                theta, end = remembered[k] * (1.0 - forgotten), far
                for _turn in range(MOST_TURNS):
                    most = find_reach(law, k, theta)
                    end = min(most, max(-most, far))
                    improved = remembered[k] + (abs(far - end) / h - remembered[k]) * forgotten
                    if not abs(improved - theta) > 1e-15 * (law[SPEED, k] + theta):
                        break
                    theta = improved
                bend[k], remembered[k] = end, theta
                kick(rows, k, 0.5 * h * law[BRISTLE, k] * end, p)
                force[frame, k] += 0.5 / steps * law[BRISTLE, k] * end
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


@inline
def find_pull(rows, law, side, p, bend, remembered, share, f, rates, pull):
    """Fill f [points] and pull [modes], and set rates [2, points] of bends and θ. share: of f in the frame, added"""
    for m in range(pull.shape[0]):
        pull[m] = 0.0
    for k in range(side.shape[0]):
        slip = project(rows, k, p) - law[VELOCITY, k]
        speed, here, rate = 0.0, bend[k], slip
        if side[k] != 0:
            here = side[k] * find_reach(law, k, remembered[k])
            shrinking = find_shrinking(law, k, remembered[k])
            speed = (side[k] * slip + shrinking * remembered[k]) / (1.0 + shrinking)
            rate = side[k] * shrinking * (speed - remembered[k])
        rates[0, k], rates[1, k] = rate, (speed - remembered[k]) / law[MEMORY, k]
        f[k] += share * law[BRISTLE, k] * here
        kick(rows, k, law[BRISTLE, k] * here, pull)


@inline
def turn_points(rows, law, side, p, bend, remembered):
    """Let points slide that are bent too far, and stick that would slip the wrong way."""
    for k in range(side.shape[0]):
        most = find_reach(law, k, remembered[k])
        if side[k] == 0:
            if abs(bend[k]) > most:
                side[k] = 1 if bend[k] > 0.0 else -1
                slipped = (abs(bend[k]) - most) / (1.0 + find_shrinking(law, k, remembered[k]))
                remembered[k] += slipped / law[MEMORY, k]  # what it has bent too far was slip
        elif (
            side[k] * (project(rows, k, p) - law[VELOCITY, k]) + find_shrinking(law, k, remembered[k]) * remembered[k]
            < 0
        ):
            bend[k], side[k] = side[k] * most, 0


@kernel
def step_runge_kutta(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Lawson's Runge-Kutta method; tables: flows of half a step and of a whole one, rows, numbers of friction, room
    [8, points], rates [4, 2, points] and sides [points]."""
    half, whole, rows, law, room, rates, side = tables
    modes, points = q.shape[0], side.shape[0]
    mid_q, mid_p, end_p = work.modal[0], work.modal[1], work.modal[2]
    first, second, third, stage_p = work.modal[3], work.modal[4], work.modal[5], work.modal[6]
    bend, remembered, there, theta = room[0], room[1], room[2], room[3]
    for k in range(points):
        bend[k], remembered[k], side[k] = 0.0, 0.0, 0
    keep(0, system, q, p, displacement, q_out, p_out)
    for frame in range(force.shape[0]):
        f = force[frame]
        for k in range(points):
            f[k] = 0.0
        for _ in range(steps):
            find_pull(rows, law, side, p, bend, remembered, 1.0 / (6.0 * steps), f, rates[0], first)
            copy(q, mid_q)
            copy(p, mid_p)
            flow_ahead(half, mid_q, mid_p)
            flow_ahead(whole, q, p)
            for m in range(modes):
                end_p[m] = p[m]
                stage_p[m] = mid_p[m] + 0.5 * h * half.pp[m] * first[m]
            for k in range(points):
                there[k] = bend[k] + 0.5 * h * rates[0, 0, k]
                theta[k] = remembered[k] + 0.5 * h * rates[0, 1, k]
            find_pull(rows, law, side, stage_p, there, theta, 1.0 / (3.0 * steps), f, rates[1], second)
            for m in range(modes):
                stage_p[m] = mid_p[m] + 0.5 * h * second[m]
            for k in range(points):
                there[k] = bend[k] + 0.5 * h * rates[1, 0, k]
                theta[k] = remembered[k] + 0.5 * h * rates[1, 1, k]
            find_pull(rows, law, side, stage_p, there, theta, 1.0 / (3.0 * steps), f, rates[2], third)
            for m in range(modes):
                stage_p[m] = end_p[m] + h * half.pp[m] * third[m]
                middle = second[m] + third[m]
                q[m] += h / 6.0 * whole.qp[m] * first[m] + h / 3.0 * half.qp[m] * middle
                p[m] += h / 6.0 * whole.pp[m] * first[m] + h / 3.0 * half.pp[m] * middle
            for k in range(points):
                there[k] = bend[k] + h * rates[2, 0, k]
                theta[k] = remembered[k] + h * rates[2, 1, k]
            find_pull(rows, law, side, stage_p, there, theta, 1.0 / (6.0 * steps), f, rates[3], second)
            for m in range(modes):
                p[m] += h / 6.0 * second[m]
            for k in range(points):
                for i in range(2):
                    rate = (rates[0, i, k] + 2.0 * (rates[1, i, k] + rates[2, i, k]) + rates[3, i, k]) / 6.0
                    room[i, k] += h * rate
            turn_points(rows, law, side, p, bend, remembered)
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


@inline
def meet_curve(law, k, u, answer, sliding):
    """Where slip + answer·F(slip) = u; returns F and on which side it slides. answer: m/(N·s); sliding: before, or 0"""
    press, speed, size = law[FORCE, k], law[SPEED, k], abs(u)
    now = 1 if u > 0.0 else -1
    b = speed - size + answer * press * law[DYNAMIC, k]
    c = speed * (answer * press * law[STATIC, k] - size)
    square = b * b - 4.0 * c
    slip = 0.5 * (-b + np.sqrt(square)) if square >= 0.0 else -1.0
    may_stick = size <= answer * press * law[STATIC, k]
    if not may_stick or (slip > 0.0 and sliding == now):
        share = speed / (speed + slip)
        return now * press * (law[DYNAMIC, k] + (law[STATIC, k] - law[DYNAMIC, k]) * share), now
    return u / answer, 0


@kernel
def step_by_curve(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """The friction curve; tables: the flow of half a step, rows, numbers of friction, and sides [points]."""
    half, rows, law, side = tables
    for k in range(side.shape[0]):
        side[k] = 0
    keep(0, system, q, p, displacement, q_out, p_out)
    for frame in range(force.shape[0]):
        for k in range(side.shape[0]):
            force[frame, k] = 0.0
        for _ in range(steps):
            flow_ahead(half, q, p)
            for k in range(side.shape[0]):
                u = project(rows, k, p) - law[VELOCITY, k]
                answer = 0.5 * h * project(rows, k, rows[k])
                f, side[k] = meet_curve(law, k, u, answer, side[k])
                kick(rows, k, h * f, p)
                force[frame, k] += f / steps
            flow_ahead(half, q, p)
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


def is_friction_alone(problem: Problem) -> bool:
    """True if surfaces rub, and there is no contact and no body that stretches."""
    return problem.friction is not None and problem.barrier.size == 0 and problem.stretch is None


def simulate_verlet(problem: Problem, steps: int) -> Trajectory:
    """Simulate friction by Störmer-Verlet with the linear part exact, in `steps` time steps per sample."""
    if not is_friction_alone(problem):
        return not_applicable(problem)
    h, points = 1.0 / (problem.samplerate * steps), problem.force_count
    tables = exact_flow(problem, h), problem.rubbed, problem.friction, np.zeros((4, points))
    return run_kernel(step_verlet, problem, steps, tables)


def simulate_lawson4(problem: Problem, steps: int) -> Trajectory:
    """Simulate friction by Lawson's Runge-Kutta method, in `steps` time steps per sample."""
    if not is_friction_alone(problem):
        return not_applicable(problem)
    h, points = 1.0 / (problem.samplerate * steps), problem.force_count
    flows = exact_flow(problem, 0.5 * h), exact_flow(problem, h)
    room = np.zeros((4, points)), np.zeros((4, 2, points)), np.zeros(points, np.int64)
    return run_kernel(step_runge_kutta, problem, steps, (*flows, problem.rubbed, problem.friction, *room))


def simulate_curve(problem: Problem, steps: int) -> Trajectory:
    """Simulate friction by the memoryless curve and the rule of hysteresis, in `steps` time steps per sample."""
    if not is_friction_alone(problem):
        return not_applicable(problem)
    h = 1.0 / (problem.samplerate * steps)
    tables = exact_flow(problem, 0.5 * h), problem.rubbed, problem.friction, np.zeros(problem.force_count, np.int64)
    return run_kernel(step_by_curve, problem, steps, tables)
