"""Störmer-Verlet, plain and with the linear part exact.

Plain: the leapfrog of Verlet, "Computer 'experiments' on classical fluids" (1967), with the loss of the modes as the
centred difference (q₊ - q₋)/2h that is usual for finite differences (Bilbao, Numerical Sound Synthesis, 2009); it is
unstable where ωh > 2. Linear part exact: Strang, "On the construction and comparison of difference schemes" (1968):
half a kick by the contacts, the modes with their weight and loss as they move without contact, half a kick (by the
tension of bodies that stretch as well). It is also
the method of Deuflhard, "A study of extrapolation methods based on multistep schemes without parasitic solutions"
(1979), in the form of Hairer, Lubich & Wanner, Geometric Numerical Integration, chapter XIII.

Choices: both are written with velocities at the samples, p = (p₋ + p₊)/2, which for the plain one is the centred
difference. The contacts' loss sees that same velocity, so it is of second order: one linear equation per contact, and
no iteration for one contact. The usual backward difference (s - s₋)/h would be explicit, but of first order: on the
lossy problems of the ruler it erred more at every step, and blew up on snare and frets at one step per sample. The
force of a step is the mean of those at its ends.
"""

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods import friction
from bench.ruler.methods.common import (
    add_forces,
    add_stretching,
    coupling,
    exact_flow,
    find_compressions,
    find_forces,
    find_forces_at,
    find_forces_with_loss,
    find_velocities,
    inline,
    keep,
    kernel,
    not_applicable,
    push,
    run_kernel,
)


@inline
def find_forces_after_flow(system, matrix, q, p, s, v, f):
    """Fill f with the forces at q; p has all of its step but them, and matrix is how they change Φ·p."""
    touching = find_compressions(system, q, s)
    if touching and system.lossy:
        find_velocities(system, p, s, v)
        find_forces_with_loss(system, matrix, s, v, f)
    else:
        find_forces(system, s, v, f)
    return touching


@kernel
def step_plainly(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Störmer-Verlet; tables: the half kick of the modes' loss h/2/(1 + σh) [modes], its coupling."""
    late_kick, matrix = tables
    modes, early_kick = q.shape[0], work.modal[0]
    s, v, f = work.contact[0], work.contact[1], work.contact[2]
    early_kick[:] = 0.5 * h
    keep(0, system, q, p, displacement, q_out, p_out)
    touching = find_forces_at(system, q, p, s, v, f)
    for frame in range(force.shape[0]):
        force[frame] = 0.0
        for _ in range(steps):
            for m in range(modes):
                p[m] += 0.5 * h * (system.weight[m] - system.omega2[m] * q[m] - 2.0 * system.sigma[m] * p[m])
            add_stretching(system, q, 0.5 * h, p)
            if touching:
                push(system, f, early_kick, p)
                add_forces(f, 0.5 / steps, force, frame)
            for m in range(modes):
                q[m] += h * p[m]
            add_stretching(system, q, 0.5 * h, p)
            for m in range(modes):
                pull = 0.5 * h * (system.weight[m] - system.omega2[m] * q[m])
                p[m] = (p[m] + pull) / (1.0 + h * system.sigma[m])
            touching = find_forces_after_flow(system, matrix, q, p, s, v, f)
            if touching:
                push(system, f, late_kick, p)
                add_forces(f, 0.5 / steps, force, frame)
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


@kernel
def step_with_exact_flow(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Half a kick by the contacts, exact motion of the modes, half a kick; tables: the flow, the half kick, its
    coupling."""
    flow, kick, matrix = tables
    modes = q.shape[0]
    s, v, f = work.contact[0], work.contact[1], work.contact[2]
    keep(0, system, q, p, displacement, q_out, p_out)
    touching = find_forces_at(system, q, p, s, v, f)
    for frame in range(force.shape[0]):
        force[frame] = 0.0
        for _ in range(steps):
            if touching:
                push(system, f, kick, p)
                add_forces(f, 0.5 / steps, force, frame)
            add_stretching(system, q, 0.5 * h, p)
            for m in range(modes):
                old = q[m]
                q[m] = flow.qq[m] * old + flow.qp[m] * p[m] + flow.qw[m]
                p[m] = flow.pq[m] * old + flow.pp[m] * p[m] + flow.pw[m]
            add_stretching(system, q, 0.5 * h, p)
            touching = find_forces_after_flow(system, matrix, q, p, s, v, f)
            if touching:
                push(system, f, kick, p)
                add_forces(f, 0.5 / steps, force, frame)
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


def simulate_verlet(problem: Problem, steps: int) -> Trajectory:
    """Simulate by Störmer-Verlet, in `steps` time steps per sample."""
    if problem.friction is not None:
        return not_applicable(problem)
    h = 1.0 / (problem.samplerate * steps)
    kick = 0.5 * h / (1.0 + h * problem.sigma)
    return run_kernel(step_plainly, problem, steps, (kick, coupling(problem, kick)))


def simulate_verlet_exact(problem: Problem, steps: int) -> Trajectory:
    """Simulate by Störmer-Verlet with the linear part exact, in `steps` time steps per sample."""
    if problem.friction is not None:
        return friction.simulate_verlet(problem, steps)
    h = 1.0 / (problem.samplerate * steps)
    kick = np.full(problem.omega.size, 0.5 * h)
    return run_kernel(step_with_exact_flow, problem, steps, (exact_flow(problem, h), kick, coupling(problem, kick)))
