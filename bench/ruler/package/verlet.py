"""`python verlet.py PROBLEM`: Störmer-Verlet, one step per sample; prints its row of the leader board."""

import sys
import time

import numpy as np
from contact_ruler import Problem, Trajectory, load_problem, score, stretching_force
from contact_ruler.leader_board import format_row


def forces(problem: Problem, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The force of each contact, N."""
    compression = np.maximum(problem.shapes @ q - problem.barrier, 0.0)
    damping = np.maximum(0.0, 1.0 + problem.loss * (problem.shapes @ p))
    return problem.stiffness * compression**problem.exponent * damping


def accelerate(problem: Problem, q: np.ndarray, p: np.ndarray, pushes: np.ndarray) -> np.ndarray:
    """dp/dt under the forces of the contacts."""
    linear = problem.weight - problem.omega**2 * q - 2 * problem.sigma * p
    return linear + stretching_force(problem, q) - pushes @ problem.shapes


def simulate(problem: Problem) -> Trajectory:
    """Compute the motion of a problem."""
    h, q, p = 1 / problem.samplerate, problem.q.copy(), problem.p.copy()
    states, mean_forces, begin = [(q.copy(), p.copy())], [], time.perf_counter()
    for _ in range(problem.frames):
        before = forces(problem, q, p)
        p += 0.5 * h * accelerate(problem, q, p, before)
        q += h * p
        after = forces(problem, q, p)
        p += 0.5 * h * accelerate(problem, q, p, after)
        states.append((q.copy(), p.copy()))
        mean_forces.append(0.5 * (before + after))
    seconds = time.perf_counter() - begin
    q, p = np.moveaxis(np.array(states), 1, 0)
    return Trajectory(q @ problem.pickup, np.array(mean_forces), q, p, seconds)


if __name__ == "__main__":
    problem, reference = load_problem(sys.argv[1])
    if problem.friction is not None:
        sys.exit(f"{sys.argv[1]}: this example has no friction")
    with np.errstate(over="ignore", invalid="ignore"):  # it can blow up
        result = simulate(problem)
    print(format_row(sys.argv[1], score(problem, reference, result), "Störmer-Verlet", "the project", "1 step"))
