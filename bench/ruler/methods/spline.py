"""The contact potential as a quadratic spline, over any problem of the ruler.

Bhanuprakash, van Walstijn & Chatziioannou, "Quadratic spline approximation of the contact potential for real-time
simulation of lumped collisions in musical instruments" (DAFx24). Read: the abstract, which says that the approximated
potential makes the update of an energy-stable implicit scheme free of iteration. Derived here: the spline, whose force
is the law's at equally spaced knots and linear between them; the scheme, a difference quotient of the potential in
each step; and its solution in closed form. Several contacts, which the paper does not treat, are solved by
Newton's method.

Linear part: exact under a force that is constant in the step, so that the energy conserved is that of the continuous
system but for the spline; or the trapezoidal rule.

Contact loss: μ times the force of the step without loss, times the rate of compression in the step; never pulls.

The modes are linear: not made for bodies that stretch, nor for friction.
"""

import time
from functools import partial

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.methods import spline_kernels as kernels
from bench.ruler.methods.common import has_more_than_contacts, not_applicable
from bench.ruler.methods.method import STEPS, Method
from bench.ruler.methods.modal_steps import EXACT, best_of_three, build_flow
from bench.ruler.methods.spline_kernels import Spline


def largest_compressions(problem: Problem) -> np.ndarray:
    """Compressions at which a contact alone has all the energy there is: [contacts], m."""
    free = problem.omega == 0
    still = np.where(free, 1.0, problem.omega)
    away = problem.q - np.where(free, 0.0, problem.weight / still**2)
    modal = 0.5 * np.sum(problem.p**2) + 0.5 * np.sum((problem.omega * away) ** 2)
    s = problem.shapes @ problem.q - problem.barrier
    mobility = np.maximum(np.sum(problem.shapes[:, free] ** 2, axis=1), 1e-300)
    pull = np.abs(problem.shapes[:, free] @ problem.weight[free]) / mobility  # of the weight, N
    stored = problem.stiffness / (problem.exponent + 1) * np.maximum(s, 0.0) ** (problem.exponent + 1)
    energy = modal + pull * np.maximum(-s, 0.0) + np.sum(stored)
    depth = np.zeros(s.size)
    for _ in range(60):  # the weight goes on pulling inside
        depth = ((problem.exponent + 1) * (energy + pull * depth) / problem.stiffness) ** (1 / (problem.exponent + 1))
    return 1.001 * depth


def build_spline(problem: Problem, q_reach: np.ndarray, knots: int) -> Spline:
    """The spline of each contact, up to the largest compression that its energy allows."""
    spacing = largest_compressions(problem) / (knots - 1)
    compression = spacing[:, None] * np.arange(knots)
    force = problem.stiffness[:, None] * compression ** problem.exponent[:, None]
    potential = np.zeros_like(force)
    potential[:, 1:] = np.cumsum(0.5 * spacing[:, None] * (force[:, 1:] + force[:, :-1]), axis=1)
    coupling = (problem.shapes * q_reach) @ problem.shapes.T
    return Spline(problem.barrier, spacing, force, potential, problem.loss, coupling)


def run(problem: Problem, steps: int, linear: str = EXACT, knots: int = 4096) -> tuple[Trajectory, np.ndarray, int]:
    """Simulate once; returns the trajectory, the energy in the contacts at samples, J, and the iterations."""
    h = 1.0 / (problem.samplerate * steps)
    flow = build_flow(problem, h, linear)
    spline = build_spline(problem, flow.q_reach, knots)
    q = np.empty((problem.frames + 1, problem.q.size))
    p, force = np.empty_like(q), np.zeros((problem.frames, problem.barrier.size))
    start, shapes = (problem.q.copy(), problem.p.copy()), np.ascontiguousarray(problem.shapes)
    begun = time.process_time()
    stored, iterations = kernels.run_one_step(flow, spline, shapes, *start, h, steps, problem.frames, q, p, force)
    seconds = time.process_time() - begun
    with np.errstate(all="ignore"):  # what blows up is returned as it is
        return Trajectory(q @ problem.pickup, force, q, p, seconds), stored, iterations


def simulate(problem: Problem, steps: int, linear: str = EXACT, knots: int = 4096) -> Trajectory:
    """Simulate a problem at a number of time steps per sample; timed."""
    if has_more_than_contacts(problem):
        return not_applicable(problem)
    return best_of_three(lambda: run(problem, steps, linear, knots)[0])


SOURCE = "Bhanuprakash, van Walstijn & Chatziioannou, DAFx24"
METHODS = (Method("quadratic spline potential", SOURCE, partial(simulate, linear=EXACT), STEPS),)
