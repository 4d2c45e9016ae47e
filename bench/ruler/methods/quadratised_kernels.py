"""Kernels of methods with quadratised contact potentials: their recurrences of the modes.

Two-step: the force of a step is an impulse at its displacement; ψ lives between the steps.
One-step: the force is constant in a step, under which the modes move exactly; ψ lives at the steps, and g is that of
the compression half a step ahead, as predicted by the last force. Both have the same solve, where the change of
compression over two steps is twice that over one.

Numba's cache knows a kernel by its own file only: after a change of quadratised_contacts.py or quadratised_stretch.py,
whose functions are compiled into the kernels here and in spline_kernels.py, delete the .nbi and .nbc files in
__pycache__.
"""

from typing import NamedTuple

import numba
import numpy as np

from bench.ruler.methods.quadratised_contacts import begin_psi, make_work, solve_step
from bench.ruler.methods.quadratised_stretch import find_means, pull_back, yield_to_contacts


class Recurrence(NamedTuple):
    """Coefficients of the two-step scheme, each [modes].

    q⁺ = now·q - before·q⁻ + drive - reach·Φᵀf;  p = ahead·q⁺ - behind·q⁻ + here·q + steady
    """

    now: np.ndarray
    before: np.ndarray
    drive: np.ndarray
    reach: np.ndarray
    ahead: np.ndarray
    behind: np.ndarray
    here: np.ndarray
    steady: np.ndarray


class Flow(NamedTuple):
    """Coefficients of the one-step scheme, each [modes].

    q⁺ = qq·q + qp·p + q_drive - q_reach·Φᵀf;  p⁺ = pq·q + pp·p + p_drive - p_reach·Φᵀf
    """

    qq: np.ndarray
    qp: np.ndarray
    q_drive: np.ndarray
    q_reach: np.ndarray
    pq: np.ndarray
    pp: np.ndarray
    p_drive: np.ndarray
    p_reach: np.ndarray


@numba.njit(cache=True, error_model="numpy")
def run_two_step(rule, gain, recurrence, contacts, stretch, shapes, start, h, steps, frames, q_out, p_out, force_out):
    """Run the two-step scheme from the displacements at time 0 and a step before: start [2, modes].

    q_out, p_out: [frames + 1, modes]; force_out: [frames, contacts], zero on entry. Returns the energy in ψ after each
    step, J: [frames·steps + 1].
    """
    number, modes = shapes.shape
    q, previous, following = start[0].copy(), start[1].copy(), np.empty(modes)
    stored = np.empty(frames * steps + 1)
    s, before, unforced = np.empty(number), np.empty(number), np.empty(number)
    work = make_work(number)
    psi, forces, active = work[0], work[4], work[5]
    for k in range(number):
        s[k] = np.dot(shapes[k], q) - contacts.barrier[k]
        before[k] = np.dot(shapes[k], previous) - contacts.barrier[k]
        begin_psi(rule, contacts, k, 0.5 * (s[k] + before[k]), psi)
    stretches = stretch.psi.size > 0
    for n in range(frames * steps + 1):
        for i in range(modes):
            following[i] = recurrence.now[i] * q[i] - recurrence.before[i] * previous[i] + recurrence.drive[i]
        if stretches:
            for i in range(modes):
                stretch.there[i] = 0.5 * (q[i] + previous[i])
                stretch.moved[i] = following[i] - previous[i]
            find_means(rule, gain, stretch, recurrence.reach, shapes, q, contacts.coupling)
            pull_back(stretch, stretch.mean, recurrence.reach, following)
        np.dot(shapes, following, unforced)
        unforced -= contacts.barrier
        count = solve_step(rule, gain, contacts, h, s, before, unforced, work)
        for i in range(count):
            k = active[i]
            for m in range(modes):
                following[m] -= recurrence.reach[m] * shapes[k, m] * forces[k]
        stored[n] = 0.5 * np.dot(psi, psi)
        if stretches:
            yield_to_contacts(stretch, forces)
            pull_back(stretch, stretch.change, recurrence.reach, following)
            stored[n] += 0.5 * np.dot(stretch.psi, stretch.psi)
        store(recurrence, previous, q, following, forces, n, steps, frames, q_out, p_out, force_out)
        previous, q, following = q, following, previous
        before, s, unforced = s, unforced, before
    return stored


@numba.njit(cache=True, error_model="numpy")
def store(recurrence, previous, q, following, forces, n, steps, frames, q_out, p_out, force_out):
    """Write the state of a step that ends a sample, and add the forces of a step to the means of its sample.

    The force of a step acts for half a step before it and for half a step after it.
    """
    frame = n // steps
    if n % steps == 0:
        for i in range(q.size):
            q_out[frame, i] = q[i]
            p_out[frame, i] = (
                recurrence.ahead[i] * following[i]
                - recurrence.behind[i] * previous[i]
                + recurrence.here[i] * q[i]
                + recurrence.steady[i]
            )
        for k in range(forces.size):
            if frame < frames:
                force_out[frame, k] += 0.5 * forces[k] / steps
            if frame > 0:
                force_out[frame - 1, k] += 0.5 * forces[k] / steps
    else:
        for k in range(forces.size):
            force_out[frame, k] += forces[k] / steps


@numba.njit(cache=True, error_model="numpy")
def run_one_step(
    rule, gain, flow, half, contacts, half_coupling, stretch, shapes, start, h, steps, frames, q_out, p_out, force_out
):
    """Run the one-step scheme from a state: start [2, modes], q and p. half: the flow of half a step.

    contacts.coupling is twice that of one step; half_coupling: of half a step, m/N
    """
    number, modes = shapes.shape
    q, p = start[0].copy(), start[1].copy()
    stored = np.empty(frames * steps)
    s, middle, before, after = np.empty(number), np.empty(number), np.empty(number), np.empty(number)
    moving, work = np.empty(modes), make_work(number)
    psi, forces, active = work[0], work[4], work[5]
    for k in range(number):
        s[k] = np.dot(shapes[k], q) - contacts.barrier[k]
        begin_psi(rule, contacts, k, s[k], psi)
    stretches = stretch.psi.size > 0
    twice = 2.0 * flow.q_reach
    q_out[0], p_out[0] = q, p
    for n in range(frames * steps):
        for i in range(modes):
            moving[i] = half.qq[i] * q[i] + half.qp[i] * p[i] + half.q_drive[i]
            earlier = q[i]
            q[i] = flow.qq[i] * earlier + flow.qp[i] * p[i] + flow.q_drive[i]
            p[i] = flow.pq[i] * earlier + flow.pp[i] * p[i] + flow.p_drive[i]
            if stretches:
                stretch.there[i], stretch.moved[i] = earlier, 2.0 * (q[i] - earlier)
        if stretches:
            pull_back(stretch, stretch.mean, half.q_reach, moving)  # as by the last forces
            for k in range(number):
                for m in range(modes):
                    moving[m] -= half.q_reach[m] * shapes[k, m] * forces[k]
            find_means(rule, gain, stretch, twice, shapes, moving, contacts.coupling)
            pull_back(stretch, stretch.mean, flow.q_reach, q)
            pull_back(stretch, stretch.mean, flow.p_reach, p)
        np.dot(shapes, q, after)
        touching = psi[0] != 0.0
        for k in range(number):
            after[k] -= contacts.barrier[k]
            touching = touching or s[k] > 0.0 or after[k] > 0.0 or psi[k] != 0.0
        count = 0
        if touching:
            np.dot(shapes, moving, middle)
            for k in range(number):
                middle[k] -= contacts.barrier[k]
                for j in range(number):
                    if not stretches:
                        middle[k] -= half_coupling[k, j] * forces[j]
            for k in range(number):
                before[k] = 2.0 * s[k] - middle[k]
                after[k] = before[k] + 2.0 * (after[k] - s[k])
            count = solve_step(rule, gain, contacts, h, middle, before, after, work)
            for k in range(number):
                s[k] += 0.5 * (after[k] - before[k])
        else:
            forces[:] = 0.0
            s[:] = after
        for i in range(count):
            k = active[i]
            force_out[n // steps, k] += forces[k] / steps
            for m in range(modes):
                q[m] -= flow.q_reach[m] * shapes[k, m] * forces[k]
                p[m] -= flow.p_reach[m] * shapes[k, m] * forces[k]
        stored[n] = 0.5 * np.dot(psi, psi)
        if stretches:
            yield_to_contacts(stretch, forces)
            pull_back(stretch, stretch.change, flow.q_reach, q)
            pull_back(stretch, stretch.change, flow.p_reach, p)
            stored[n] += 0.5 * np.dot(stretch.psi, stretch.psi)
        if (n + 1) % steps == 0:
            q_out[(n + 1) // steps], p_out[(n + 1) // steps] = q, p
    return stored
