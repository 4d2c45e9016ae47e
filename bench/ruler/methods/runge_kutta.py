"""The classical Runge-Kutta method of order 4, plain and with the linear part exact.

Plain: Kutta, "Beitrag zur näherungsweisen Integration totaler Differentialgleichungen" (1901), on (q, p). Linear part
exact: Lawson, "Generalized Runge-Kutta processes for stable systems with large Lipschitz constants" (1967): the same
method in variables that follow the exact motion of the free modes, their weight and loss included.

The force of a step is that of its stages, weighted as the method weighs them: (f₁ + 2·f₂ + 2·f₃ + f₄)/6. The order is
that of the force's smoothness: below 4 where a contact closes with a small exponent.
"""

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods import friction
from bench.ruler.methods.common import (
    add_forces,
    add_stretching,
    exact_flow,
    find_forces_at,
    inline,
    keep,
    kernel,
    not_applicable,
    run_kernel,
)


@inline
def find_pull(system, q, f, touching, pull):
    """Fill pull [modes], √kg·m/s², with what the contacts and the stretch at q do to each mode."""
    for m in range(pull.shape[0]):
        pull[m] = 0.0
    if touching:
        for k in range(f.shape[0]):
            if f[k] != 0.0:
                for m in range(pull.shape[0]):
                    pull[m] -= system.shapes[k, m] * f[k]
    add_stretching(system, q, 1.0, pull)


@kernel
def step_plainly(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Classical Runge-Kutta; no tables."""
    modes = q.shape[0]
    s, v, f = work.contact[0], work.contact[1], work.contact[2]
    room = work.modal
    stage_q, stage_p, sum_q, sum_p, pull = room[0], room[1], room[2], room[3], room[4]
    reach = (0.5 * h, 0.5 * h, h, 0.0)  # from the start to the next stage
    share = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
    keep(0, system, q, p, displacement, q_out, p_out)
    for frame in range(force.shape[0]):
        force[frame] = 0.0
        for _ in range(steps):
            for m in range(modes):
                stage_q[m], stage_p[m], sum_q[m], sum_p[m] = q[m], p[m], q[m], p[m]
            for stage in range(4):
                touching = find_forces_at(system, stage_q, stage_p, s, v, f)
                find_pull(system, stage_q, f, touching, pull)
                if touching:
                    add_forces(f, share[stage] / steps, force, frame)
                part, far = share[stage] * h, reach[stage]
                for m in range(modes):
                    rate = stage_p[m]
                    pulled = pull[m] + system.weight[m] - system.omega2[m] * stage_q[m] - 2.0 * system.sigma[m] * rate
                    sum_q[m] += part * rate
                    sum_p[m] += part * pulled
                    stage_q[m] = q[m] + far * rate
                    stage_p[m] = p[m] + far * pulled
            for m in range(modes):
                q[m], p[m] = sum_q[m], sum_p[m]
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


@kernel
def step_with_exact_flow(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out):
    """Lawson's Runge-Kutta method; tables: the flows of half a step and of a whole one."""
    half, whole = tables
    modes = q.shape[0]
    s, v, f = work.contact[0], work.contact[1], work.contact[2]
    room = work.modal
    mid_q, mid_p, end_q, end_p = room[0], room[1], room[2], room[3]
    stage_q, stage_p, pull, sum_pull = room[4], room[5], room[6], room[7]
    keep(0, system, q, p, displacement, q_out, p_out)
    for frame in range(force.shape[0]):
        force[frame] = 0.0
        for _ in range(steps):
            touching = find_forces_at(system, q, p, s, v, f)
            find_pull(system, q, f, touching, pull)
            if touching:
                add_forces(f, 1.0 / (6.0 * steps), force, frame)
            # in short loops: what touches many arrays at once is not vectorised
            for m in range(modes):  # where the free motion leads in half a step
                mid_q[m] = half.qq[m] * q[m] + half.qp[m] * p[m] + half.qw[m]
                mid_p[m] = half.pq[m] * q[m] + half.pp[m] * p[m] + half.pw[m]
            for m in range(modes):
                stage_q[m] = mid_q[m] + 0.5 * h * half.qp[m] * pull[m]
                stage_p[m] = mid_p[m] + 0.5 * h * half.pp[m] * pull[m]
            for m in range(modes):  # and in a whole one; q and p become the start of the fourth stage
                old = q[m]
                q[m] = whole.qq[m] * old + whole.qp[m] * p[m] + whole.qw[m]
                p[m] = whole.pq[m] * old + whole.pp[m] * p[m] + whole.pw[m]
            for m in range(modes):
                end_q[m] = q[m] + h / 6.0 * whole.qp[m] * pull[m]
                end_p[m] = p[m] + h / 6.0 * whole.pp[m] * pull[m]
            touching = find_forces_at(system, stage_q, stage_p, s, v, f)
            find_pull(system, stage_q, f, touching, sum_pull)
            if touching:
                add_forces(f, 1.0 / (3.0 * steps), force, frame)
            for m in range(modes):  # q has no force of its own: only p differs from the middle
                stage_p[m] = mid_p[m] + 0.5 * h * sum_pull[m]
            touching = find_forces_at(system, mid_q, stage_p, s, v, f)
            find_pull(system, mid_q, f, touching, pull)
            if touching:
                add_forces(f, 1.0 / (3.0 * steps), force, frame)
            for m in range(modes):
                stage_q[m] = q[m] + h * half.qp[m] * pull[m]
                stage_p[m] = p[m] + h * half.pp[m] * pull[m]
                sum_pull[m] += pull[m]
            touching = find_forces_at(system, stage_q, stage_p, s, v, f)
            find_pull(system, stage_q, f, touching, pull)
            if touching:
                add_forces(f, 1.0 / (6.0 * steps), force, frame)
            for m in range(modes):
                q[m] = end_q[m] + h / 3.0 * half.qp[m] * sum_pull[m]
                p[m] = end_p[m] + h / 3.0 * half.pp[m] * sum_pull[m] + h / 6.0 * pull[m]
        keep(frame + 1, system, q, p, displacement, q_out, p_out)


def simulate_rk4(problem: Problem, steps: int) -> Trajectory:
    """Simulate by the classical Runge-Kutta method, in `steps` time steps per sample."""
    if problem.friction is not None:
        return not_applicable(problem)
    return run_kernel(step_plainly, problem, steps, ())


def simulate_lawson4(problem: Problem, steps: int) -> Trajectory:
    """Simulate by Lawson's Runge-Kutta method with the linear part exact, in `steps` time steps per sample."""
    if problem.friction is not None:
        return friction.simulate_lawson4(problem, steps)
    h = 1.0 / (problem.samplerate * steps)
    return run_kernel(step_with_exact_flow, problem, steps, (exact_flow(problem, 0.5 * h), exact_flow(problem, h)))
