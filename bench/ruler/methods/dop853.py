"""DOP853 of SciPy, stopped where contacts close and open, and where points of friction slide and stick.

Source: Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I (1993), section II.10, as scipy.integrate's
DOP853, whose steps and error control are its own. The numbers of the problem are not smooth where s_k = 0, so a step
that passes there is cut at the crossing (found on its own interpolant), and the method starts again with that contact
closed or open: it integrates only smooth parts, the force of an open contact being 0 within one. The interpolant of
each step is looked at in several places, lest a contact closes and opens within it unseen.

The impulses of contacts and friction are states of their own, which error control does not look at. Relative tolerance:
as given (1e-6, 1e-9, 1e-12); absolute: the same share of what the energy of the start, or the weight, can do to a mode.
Time is that of Python, with NumPy's products; a run that takes more than 20 s is given up, and is not a number from
there on.
"""

import time
from collections.abc import Callable

import numpy as np
import scipy

from bench.ruler.contact_ruler.problem import Problem, energy_of, stretching_force
from bench.ruler.contact_ruler.trajectory import Trajectory
from bench.ruler.rubbing import Bristles, as_rubbing, excess_of, friction_forces, rates, reach, turn

GIVEN_UP_SECONDS = 20.0
LOOKED_AT = np.array([0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0])  # of a step
UNCHECKED = 1e300  # absolute tolerance of what error control shall not look at


def smallest_sizes(problem: Problem) -> np.ndarray:
    """What counts as large for each state: q, p [modes each]; impulses [contacts + points of friction] do not count;
    bends of bristles and θ [points each]."""
    duration = problem.frames / problem.samplerate
    energy = abs(float(energy_of(problem, problem.q, problem.p))) + float(np.sum(np.abs(problem.weight * problem.q)))
    speed = np.sqrt(2.0 * energy) + np.abs(problem.weight) * duration
    law = as_rubbing(problem, float).law
    impulses = np.full(problem.force_count, UNCHECKED)
    modal = speed / np.maximum(problem.omega, 1.0 / duration), speed
    return np.concatenate([*modal, impulses, reach(law, np.zeros(law.speed.size)), law.speed])


class SmoothPart:
    """The motion while the same contacts are closed, and the same points of friction slide."""

    def __init__(self, problem: Problem, closed: np.ndarray, side: np.ndarray) -> None:
        self.problem, self.closed, self.side = problem, closed, side
        self.rubbing = as_rubbing(problem, float)
        self.modes = problem.omega.size
        self.touching = np.flatnonzero(closed)
        self.rows, self.barrier = problem.shapes[self.touching], problem.barrier[self.touching]
        self.stiffness, self.exponent = problem.stiffness[self.touching], problem.exponent[self.touching]
        self.loss = problem.loss[self.touching]
        self.lossy = bool(self.loss.any())
        self.omega2, self.twice_sigma = problem.omega**2, 2.0 * problem.sigma

    def rate(self, _: float, y: np.ndarray) -> np.ndarray:
        """dy/dt of the states q, p, impulses, bends, θ."""
        problem, n = self.problem, self.modes
        q, p = y[:n], y[n : 2 * n]
        rate = np.zeros(y.size)
        rate[:n] = p
        rate[n : 2 * n] = problem.weight - self.omega2 * q - self.twice_sigma * p
        if problem.stretch is not None:
            rate[n : 2 * n] += stretching_force(problem, q)
        if self.touching.size:
            f = self.stiffness * np.maximum(self.rows @ q - self.barrier, 0.0) ** self.exponent
            if self.lossy:
                f *= np.maximum(1.0 + self.loss * (self.rows @ p), 0.0)
            rate[n : 2 * n] -= f @ self.rows
            rate[2 * n + self.touching] = f
        if self.side.size:
            bristles, slip = self.bristles_at(y)
            f = friction_forces(self.rubbing.law, bristles)
            rate[n : 2 * n] -= f @ self.rubbing.shapes
            rate[2 * n + self.problem.barrier.size :] = np.concatenate([f, *rates(self.rubbing.law, bristles, slip)])
        return rate

    def bristles_at(self, y: np.ndarray) -> tuple[Bristles, np.ndarray]:
        """The bristles, and the slip of the surfaces, m/s; y: [..., states]"""
        (shapes, law), n, points = self.rubbing, self.modes, self.side.size
        slip = y[..., n : 2 * n] @ shapes.T - law.velocity
        return Bristles(
            y[..., y.shape[-1] - 2 * points : y.shape[-1] - points], y[..., y.shape[-1] - points :], self.side
        ), slip

    def excess(self, y: np.ndarray) -> np.ndarray:
        """How far each contact is on the side where it should not be, m, and then each point of friction; y: [...,
        states]"""
        s = y[..., : self.modes] @ self.problem.shapes.T - self.problem.barrier
        of_contacts = np.where(self.closed, -s, s)
        return np.concatenate([of_contacts, excess_of(self.rubbing.law, *self.bristles_at(y))], axis=-1)

    def after(self, y: np.ndarray, k: int) -> tuple[np.ndarray, "SmoothPart"]:
        """The state and the motion when contact k, or after them a point of friction, has changed."""
        closed, side, points = self.closed.copy(), self.side, self.side.size
        if k < closed.size:
            closed[k] = not closed[k]
        else:
            bristles = turn(self.rubbing.law, self.bristles_at(y)[0], k - closed.size)
            y, side = y.copy(), bristles.side
            y[y.size - 2 * points : y.size - points] = bristles.bend
        return y, SmoothPart(self.problem, closed, side)


def find_crossing(
    part: SmoothPart, solver: "scipy.integrate.DOP853", motion: Callable[..., np.ndarray]
) -> tuple[float, int] | None:
    """When the first contact changes within the last step, and which; None if none does."""
    times = solver.t_old + LOOKED_AT * (solver.t - solver.t_old)
    wrong = part.excess(motion(times).T) > 0.0
    if not wrong.any():
        return None
    row = int(np.argmax(wrong.any(axis=1)))
    begun, ended = (solver.t_old if row == 0 else times[row - 1]), times[row]
    crossings = [(crossing_of(part, motion, int(k), begun, ended), int(k)) for k in np.flatnonzero(wrong[row])]
    return min(crossings)


def crossing_of(part: SmoothPart, motion: Callable[..., np.ndarray], k: int, begun: float, ended: float) -> float:
    """When contact k passes to the wrong side between two times, of which the later is on that side."""
    if part.excess(motion(begun))[k] < 0.0:
        right = begun
    else:  # it begins with the change just made, at 0, and may have been on the right side for less than this time
        shares = (begun + 0.5**n * (ended - begun) for n in range(1, 30))
        right = next((t for t in shares if part.excess(motion(t))[k] < 0.0), ended)
    if right == ended:
        return begun
    return float(scipy.optimize.brentq(lambda t: part.excess(motion(t))[k], right, ended, xtol=1e-18, rtol=1e-15))


def simulate_dop853(problem: Problem, tolerance: float) -> Trajectory:
    """Simulate by DOP853 with events, at a relative tolerance."""
    with np.errstate(over="ignore", invalid="ignore"):  # of steps that are then taken again, shorter
        return integrate(problem, tolerance)


def integrate(problem: Problem, tolerance: float) -> Trajectory:
    """Integrate from crossing to crossing."""
    begun = time.process_time()
    n, forces = problem.omega.size, problem.force_count
    at = np.arange(problem.frames + 1) / problem.samplerate
    side = np.zeros(forces - problem.barrier.size, int)
    y = np.concatenate([problem.q, problem.p, np.zeros(forces + 2 * side.size)]).astype(float)
    states = np.full((problem.frames + 1, y.size), np.nan)
    s = problem.shapes @ problem.q - problem.barrier
    closed = (s > 0.0) | ((s == 0.0) & (problem.shapes @ problem.p > 0.0))
    sizes, now, done = tolerance * smallest_sizes(problem), 0.0, 1
    states[0], part = y, SmoothPart(problem, closed, side)
    while done <= problem.frames:
        solver = scipy.integrate.DOP853(part.rate, now, y, at[-1], rtol=tolerance, atol=sizes)
        crossing = None
        while solver.status == "running" and crossing is None:
            if time.process_time() - begun > GIVEN_UP_SECONDS:
                done = problem.frames + 1
                break
            solver.step()
            motion = solver.dense_output()
            crossing = find_crossing(part, solver, motion)
            until = solver.t if crossing is None else crossing[0]
            while done <= problem.frames and at[done] <= until:
                states[done] = motion(at[done])
                done += 1
        if crossing is None:
            break
        now, k = crossing
        y, part = part.after(motion(now), k)
    impulse = np.diff(states[:, 2 * n : 2 * n + forces], axis=0)
    seconds = time.process_time() - begun
    q, p = states[:, :n], states[:, n : 2 * n]
    return Trajectory(q @ problem.pickup, impulse * problem.samplerate, q, p, seconds)
