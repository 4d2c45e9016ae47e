"""Kernels of a contact potential that is a quadratic spline: its force is piecewise linear, knots are equally spaced.

One-step scheme: in each step the linear part runs exactly (or by the trapezoidal rule) under a constant force f, the
difference quotient of the spline potential V over the step:

    s⁺ - s = d = d* - C·f,      f = (V(s⁺) - V(s))/d + damping·d/h

Between two knots of s⁺ this is a quadratic equation of d. Several contacts are solved by Newton's method.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

from bench.ruler.methods.quadratised_contacts import eliminate

STEPS = 300  # at most, of Newton's method for contacts that act on each other
TOLERANCE = 1e-14  # at which they end: error of a change of compression, share of it and of the compression


class Spline(NamedTuple):
    """Contacts whose potential is a quadratic spline of the compression, from 0 on."""

    barrier: np.ndarray  # [contacts], m
    spacing: np.ndarray  # of the knots [contacts], m
    force: np.ndarray  # at the knots [contacts, knots], N
    potential: np.ndarray  # at the knots [contacts, knots], J
    loss: np.ndarray  # [contacts], s/m
    coupling: np.ndarray  # C: compression that unit forces take away in a step [contacts, contacts], m/N


@numba.njit(cache=True, error_model="numpy")
def interval_of(spline, k, s):
    """Interval between knots in which a compression is; -1 below 0; the last one has no end."""
    if not s > 0.0:
        return -1
    return int(min(s / spline.spacing[k], float(spline.force.shape[1] - 2)))


@numba.njit(cache=True, error_model="numpy")
def expand_spline(spline, k, i, s):
    """Potential, force and stiffness at a compression, by the polynomial of interval i."""
    if i < 0:
        return 0.0, 0.0, 0.0
    past = s - i * spline.spacing[k]
    slope = (spline.force[k, i + 1] - spline.force[k, i]) / spline.spacing[k]
    return (
        spline.potential[k, i] + past * (spline.force[k, i] + 0.5 * past * slope),
        spline.force[k, i] + past * slope,
        slope,
    )


@numba.njit(cache=True, error_model="numpy")
def mean_force(spline, k, s, d):
    """Difference quotient of the potential from s to s + d, N, without cancellation for small d."""
    here, there = interval_of(spline, k, s), interval_of(spline, k, s + d)
    start, force, slope = expand_spline(spline, k, here, s)
    if here == there:
        return force + 0.5 * d * slope
    return (expand_spline(spline, k, there, s + d)[0] - start) / d


@numba.njit(cache=True, error_model="numpy")
def is_beyond(spline, k, s, i, free, stiffened):
    """Whether a contact ends its step beyond knot i: there, its motion and force are too small for the equation."""
    d = i * spline.spacing[k] - s
    return stiffened * d + spline.coupling[k, k] * mean_force(spline, k, s, d) <= free


@numba.njit(cache=True, error_model="numpy")
def solve_contact(spline, k, s, free, damping):
    """d of one contact, m: d + C·(mean force + damping·d) = free. No iteration but the search for the interval."""
    resistance = spline.coupling[k, k]
    stiffened = 1.0 + resistance * damping
    low, high = -1, interval_of(spline, k, max(s, s + free / stiffened))
    if high < 0:
        return free / stiffened
    here = interval_of(spline, k, s)
    width = 1  # of steps away from the interval of s, which double until s⁺ is passed
    if here >= 0 and not is_beyond(spline, k, s, here, free, stiffened):
        high = here - 1
        while high - width >= low and not is_beyond(spline, k, s, high - width + 1, free, stiffened):
            high, width = high - width, 2 * width
        low = max(low, high - width + 1) if high - width >= low else low
    else:
        low = max(here, 0)
        while low + width <= high and is_beyond(spline, k, s, low + width, free, stiffened):
            low, width = low + width, 2 * width
        high = min(high, low + width - 1)
    while low < high:
        i = (low + high + 1) // 2
        if is_beyond(spline, k, s, i, free, stiffened):
            low = i
        else:
            high = i - 1
    start, force, slope = expand_spline(spline, k, here, s)
    if low == here:
        return (free - resistance * force) / (stiffened + 0.5 * resistance * slope)
    there, pull, slope = expand_spline(spline, k, low, s)  # of the polynomial of s⁺, continued to s
    square = stiffened + 0.5 * resistance * slope
    linear = resistance * pull - free
    root = math.sqrt(max(linear * linear - 4.0 * square * resistance * (there - start), 0.0))
    if low > here:  # d > 0: the larger root
        return (
            (root - linear) / (2.0 * square) if linear <= 0.0 else 2.0 * resistance * (start - there) / (linear + root)
        )
    return -(root + linear) / (2.0 * square) if linear >= 0.0 else 2.0 * resistance * (there - start) / (root - linear)


@numba.njit(cache=True, error_model="numpy")
def force_and_slope(spline, k, s, d, damping):
    """Force of a contact that moves by d, N, and its derivative by d, N/m."""
    force = mean_force(spline, k, s, d)
    i = interval_of(spline, k, s + d)
    _, pull, slope = expand_spline(spline, k, i, s + d)
    slope = 0.5 * slope if i == interval_of(spline, k, s) else (pull - force) / d
    force += damping * d
    return (force, slope + damping) if force > 0.0 else (0.0, 0.0)


@numba.njit(cache=True, error_model="numpy")
def solve_alone(spline, s, free, damping, forces):
    """Force of the only contact, N."""
    d = solve_contact(spline, 0, s[0], free[0], damping[0])
    forces[0] = force_and_slope(spline, 0, s[0], d, damping[0])[0]


@numba.njit(cache=True, error_model="numpy")
def evaluate_forces(spline, s, free, damping, d, forces, slopes, misses):
    """Forces of contacts that move by d, and by how much d misses their effect, m; returns the largest, as a share."""
    largest = 0.0
    for k in range(s.size):
        forces[k], slopes[k] = 0.0, 0.0
        if s[k] > 0.0 or s[k] + d[k] > 0.0:
            forces[k], slopes[k] = force_and_slope(spline, k, s[k], d[k], damping[k])
    for k in range(s.size):
        misses[k] = d[k] - free[k]
        for j in range(s.size):
            misses[k] += spline.coupling[k, j] * forces[j]
        largest = max(largest, abs(misses[k]) / (abs(s[k]) + abs(free[k]) + 1e-300))
    return largest


@numba.njit(cache=True, error_model="numpy")
def solve_together(spline, s, free, damping, forces, d, trial, slopes, misses, right, active, matrix):
    """Forces of several contacts, N: Newton's method, from their last forces; returns its steps.

    Where it comes no closer, each contact is solved in turn for the forces of the others, which always converges.
    """
    number = s.size
    for k in range(number):
        d[k] = free[k]
        for j in range(number):
            d[k] -= spline.coupling[k, j] * forces[j]
    miss = evaluate_forces(spline, s, free, damping, d, forces, slopes, misses)
    for step in range(STEPS):
        if miss < TOLERANCE:
            return step
        count = 0
        for k in range(number):
            trial[k] = d[k] - misses[k]
            if slopes[k] != 0.0:
                active[count] = k
                count += 1
        for i in range(count):
            for j in range(count):
                matrix[i, j] = spline.coupling[active[i], active[j]] * slopes[active[j]]
            matrix[i, i] += 1.0
            right[i] = misses[active[i]]
        eliminate(matrix, right, count)
        for k in range(number):  # the others follow the forces of those whose force changes
            for i in range(count):
                trial[k] += spline.coupling[k, active[i]] * slopes[active[i]] * right[i]
        closer = evaluate_forces(spline, s, free, damping, trial, forces, slopes, misses)
        if closer < miss:
            d[:] = trial
            miss = closer
            continue
        if miss < 1e3 * TOLERANCE:  # rounding
            evaluate_forces(spline, s, free, damping, d, forces, slopes, misses)
            return step
        evaluate_forces(spline, s, free, damping, d, forces, slopes, misses)
        for _ in range(3):
            for k in range(number):
                rest = free[k]
                for j in range(number):
                    if j != k:
                        rest -= spline.coupling[k, j] * forces[j]
                d[k], forces[k] = rest, 0.0
                if s[k] > 0.0 or s[k] + rest > 0.0:
                    d[k] = solve_contact(spline, k, s[k], rest, damping[k])
                    forces[k] = force_and_slope(spline, k, s[k], d[k], damping[k])[0]
        miss = evaluate_forces(spline, s, free, damping, d, forces, slopes, misses)
    return STEPS


@numba.njit(cache=True, error_model="numpy")
def make_work(number):
    """Scratch of solve_together."""
    return (
        np.empty(number),
        np.empty(number),
        np.empty(number),
        np.empty(number),
        np.empty(number),
        np.empty(number, np.int64),
        np.empty((number, number)),
    )


@numba.njit(cache=True, error_model="numpy")
def run_one_step(flow, spline, shapes, q, p, h, steps, frames, q_out, p_out, force_out):
    """Run the one-step scheme from a state q, p, which it changes; returns the energy in the contacts, and iterations.

    q_out, p_out: [frames + 1, modes]; force_out: [frames, contacts], zero on entry; energy: [frames + 1], J
    """
    number, modes = shapes.shape
    s, after, free = np.empty(number), np.empty(number), np.empty(number)
    forces, damping = np.zeros(number), np.zeros(number)
    stored, iterations = np.zeros(frames + 1), 0
    work = make_work(number)
    lossy = spline.loss.max() > 0.0
    for k in range(number):
        s[k] = np.dot(shapes[k], q) - spline.barrier[k]
    for n in range(frames * steps + 1):
        if n % steps == 0:
            for i in range(modes):
                q_out[n // steps, i], p_out[n // steps, i] = q[i], p[i]
            for k in range(number):
                stored[n // steps] += expand_spline(spline, k, interval_of(spline, k, s[k]), s[k])[0]
        if n == frames * steps:
            break
        for i in range(modes):
            before = q[i]
            q[i] = flow.qq[i] * before + flow.qp[i] * p[i] + flow.q_drive[i]
            p[i] = flow.pq[i] * before + flow.pp[i] * p[i] + flow.p_drive[i]
        touching = False
        np.dot(shapes, q, after)
        for k in range(number):
            after[k] -= spline.barrier[k]
            free[k] = after[k] - s[k]
            touching = touching or s[k] > 0.0 or after[k] > 0.0
            damping[k] = 0.0
        if touching:
            for lossless in (True, False):
                if not lossless:  # with the loss of the force that there is without loss
                    for k in range(number):
                        damping[k] = spline.loss[k] * forces[k] / h
                if number == 1:
                    solve_alone(spline, s, free, damping, forces)
                else:
                    iterations += solve_together(spline, s, free, damping, forces, *work)
                if not lossy:
                    break
        else:
            forces[:] = 0.0
        for k in range(number):
            if forces[k] != 0.0:
                force_out[n // steps, k] += forces[k] / steps
                for j in range(number):
                    after[j] -= spline.coupling[j, k] * forces[k]
                for i in range(modes):
                    q[i] -= flow.q_reach[i] * shapes[k, i] * forces[k]
                    p[i] -= flow.p_reach[i] * shapes[k, i] * forces[k]
        s, after = after, s
    return stored, iterations
