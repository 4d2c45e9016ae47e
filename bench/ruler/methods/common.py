"""What the methods share: a problem as arrays for compiled code, the law of a contact, the exact motion of free modes,
and how a kernel is run and timed.

A kernel is called as kernel(system, tables, work, steps, h, q, p, displacement, force, q_out, p_out): it starts from q,
p [modes], which it may overwrite, makes `steps` time steps of h seconds for each of the frames, and fills displacement
[frames + 1], force [frames, contacts + points of friction] and, if they have rows, q_out and p_out [frames + 1, modes].
Nothing is raised when a motion blows up: its numbers become infinite, or not numbers.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory

TIMED_RUNS = 3
TIMED_SECONDS = 2.0  # that the timed runs may take together
COMPILED_FRAMES = 2  # of the first run, which compiles

# 1/0 is inf, not an exception; without reference counts (_nrt), which took nine tenths of the time of one mode, and so
# without arrays made in compiled code
# A cached kernel does not notice a change of what it calls in another file: then remove the folder __pycache__.
OPTIONS: dict[str, Any] = {"cache": True, "fastmath": False, "error_model": "numpy", "_nrt": False}
kernel = numba.njit(**OPTIONS)  # what is called
inline = numba.njit(**OPTIONS, forceinline=True)  # what is small, and part of what calls it


class System(NamedTuple):
    """A problem without its start, for compiled code (bench.ruler.contact_ruler.problem)."""

    omega2: np.ndarray  # ω² [modes], 1/s²
    sigma: np.ndarray  # [modes], 1/s
    weight: np.ndarray  # [modes], √kg·m/s²
    shapes: np.ndarray  # Φ [contacts, modes], 1/√kg
    barrier: np.ndarray  # [contacts], m
    stiffness: np.ndarray  # [contacts], N/m^α
    exponent: np.ndarray  # [contacts]
    loss: np.ndarray  # [contacts], s/m
    pickup: np.ndarray  # [1, modes], 1/√kg
    stretch: np.ndarray  # [bodies that stretch, modes], √(N/m)/(kg·m)
    lossy: bool  # whether any contact has loss


class Work(NamedTuple):
    """Room for a kernel, of zeros."""

    modal: np.ndarray  # [8, modes]
    contact: np.ndarray  # [12, contacts]
    square: np.ndarray  # [contacts, contacts]
    index: np.ndarray  # [contacts], of int64
    marks: np.ndarray  # [2, contacts], of bool


class Flow(NamedTuple):
    """The exact motion of free modes over a time: q' = qq·q + qp·p + qw, p' = pq·q + pp·p + pw; each [modes]."""

    qq: np.ndarray
    qp: np.ndarray
    qw: np.ndarray  # due to the weight
    pq: np.ndarray
    pp: np.ndarray
    pw: np.ndarray


def system_of(problem: Problem) -> System:
    """A problem as arrays for compiled code."""
    arrays = (
        problem.omega**2,
        problem.sigma,
        problem.weight,
        problem.shapes,
        problem.barrier,
        problem.stiffness,
        problem.exponent,
        problem.loss,
        problem.pickup[None, :],
        np.zeros((0, problem.omega.size)) if problem.stretch is None else problem.stretch,
    )
    return System(*(np.ascontiguousarray(a, dtype=np.float64) for a in arrays), lossy=bool(np.any(problem.loss > 0.0)))


def room_for(problem: Problem) -> Work:
    """Room for a kernel on a problem."""
    modes, contacts = problem.omega.size, problem.barrier.size
    return Work(
        modal=np.zeros((8, modes)),
        contact=np.zeros((12, contacts)),
        square=np.zeros((contacts, contacts)),
        index=np.zeros(contacts, np.int64),
        marks=np.zeros((2, contacts), np.bool_),
    )


def exact_flow(problem: Problem, seconds: float) -> Flow:
    """How the modes move in a time, which may be negative, without contact."""
    omega2, sigma, t = problem.omega**2, problem.sigma, seconds
    damped = np.sqrt((omega2 - sigma**2).astype(complex))  # imaginary above critical damping
    safe = np.where(damped == 0.0, 1.0, damped)
    cosine, sine = np.cos(damped * t).real, np.where(damped == 0.0, t, np.sin(damped * t) / safe).real
    decay = np.exp(-sigma * t)
    qq, qp = decay * (cosine + sigma * sine), decay * sine
    half_sine = np.sin(0.5 * damped * t)
    one_minus_qq = -np.expm1(-sigma * t) + decay * (2.0 * half_sine**2).real - decay * sigma * sine
    drifting = np.where(sigma > 0.0, (t - qp) / np.where(sigma > 0.0, 2.0 * sigma, 1.0), 0.5 * t * t)  # where ω = 0
    pushed = np.where(omega2 > 0.0, one_minus_qq / np.where(omega2 > 0.0, omega2, 1.0), drifting)
    return Flow(qq, qp, pushed * problem.weight, -omega2 * qp, decay * (cosine - sigma * sine), qp * problem.weight)


def exact_recurrence(problem: Problem, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The exact two-step recurrence of free modes: q₊ = a·q - e·q₋ + b·(force of each mode); a, e, b: [modes].

    With it, the force is taken such that a constant one is met exactly: b = (1 + e - a)/ω² (Bilbao, Numerical Sound
    Synthesis, 2009; the Γ and Σ* of Issanchou et al., 2017 and 2018, give the same).
    """
    omega2, sigma = problem.omega**2, problem.sigma
    damped = np.sqrt((omega2 - sigma**2).astype(complex))
    decay = np.exp(-sigma * h)
    missing = np.expm1(-sigma * h) ** 2 + 4.0 * decay * (np.sin(0.5 * damped * h) ** 2).real  # 1 + e - a
    drifting = np.where(sigma > 0.0, -np.expm1(-2.0 * sigma * h) / np.where(sigma > 0.0, 2.0 * sigma, 1.0), h) * h
    return (
        1.0 + decay**2 - missing,
        decay**2,
        np.where(omega2 > 0.0, missing / np.where(omega2 > 0.0, omega2, 1.0), drifting),
    )


def coupling(problem: Problem, diagonal: np.ndarray | float) -> np.ndarray:
    """Φ·diag(diagonal)·Φᵀ: how a force at one contact is felt at another; [contacts, contacts]."""
    return np.ascontiguousarray((problem.shapes * diagonal) @ problem.shapes.T)


def run_kernel(kernel: Callable[..., None], problem: Problem, steps: int, tables: tuple[Any, ...]) -> Trajectory:
    """Run a kernel on a problem: once to compile, then timed without storing the states, then once with them.

    steps: time steps per sample
    tables: what the kernel needs besides the system
    """
    system, h = system_of(problem), 1.0 / (problem.samplerate * steps)
    modes, forces = problem.omega.size, problem.force_count

    def run(frames: int, kept: bool) -> Trajectory:
        displacement, force = np.full(frames + 1, np.nan), np.full((frames, forces), np.nan)
        q, p = (np.full((frames + 1 if kept else 0, modes), np.nan) for _ in range(2))
        start = (np.array(problem.q, dtype=np.float64), np.array(problem.p, dtype=np.float64))
        work = room_for(problem)
        began = time.process_time()
        kernel(system, tables, work, np.int64(steps), h, *start, displacement, force, q, p)
        return Trajectory(displacement, force, q, p, time.process_time() - began)

    run(min(COMPILED_FRAMES, problem.frames), kept=False)
    times: list[float] = []
    while len(times) < TIMED_RUNS and sum(times) + min(times, default=0.0) < TIMED_SECONDS:
        times.append(run(problem.frames, kept=False).seconds)
    return run(problem.frames, kept=True)._replace(seconds=min(times))


def not_applicable(problem: Problem) -> Trajectory:
    """What a method returns for a problem that it is not made for: no numbers, and no time taken."""
    return Trajectory(np.full(problem.frames + 1, np.nan), np.full((problem.frames, problem.force_count), np.nan))


def has_more_than_contacts(problem: Problem) -> bool:
    """True if bodies of a problem stretch, or surfaces rub: most methods for contacts are not made for these."""
    return problem.stretch is not None or problem.friction is not None


def was_applicable(trajectory: Trajectory) -> bool:
    """Whether a method is made for the problem; one that blew up has taken time all the same."""
    return not np.isnan(trajectory.seconds)


@numba.njit(**OPTIONS | {"fastmath": {"reassoc"}}, forceinline=True)  # any order of the sum, so that it is vectorised
def project(rows, k, x):
    """rows[k]·x: most of the time of many modes and contacts, of which it would take four times as much in order."""
    total = 0.0
    for i in range(x.shape[0]):
        total += rows[k, i] * x[i]
    return total


@inline
def copy(values, out):
    """out = values, both [n]; a slice would be copied by way of a new array."""
    for i in range(values.shape[0]):
        out[i] = values[i]


@inline
def power(s, exponent):
    """s^exponent for s ≥ 0; the common exponents without the slow general power."""
    if exponent == 1.0:
        return s
    if exponent == 1.5:
        return s * np.sqrt(s)
    if exponent == 2.0:
        return s * s
    if exponent == 3.0:
        return s * s * s
    return s**exponent


@inline
def find_compressions(system, q, s):
    """Fill s [contacts], m, with the compressions at q; returns whether any is positive."""
    touching = False
    for k in range(s.shape[0]):
        s[k] = project(system.shapes, k, q) - system.barrier[k]
        touching |= not s[k] <= 0.0  # also if it is not a number
    return touching


@inline
def find_velocities(system, p, s, v):
    """Fill v [contacts], m/s, with the rates of compression where s > 0."""
    for k in range(s.shape[0]):
        v[k] = project(system.shapes, k, p) if s[k] > 0.0 else 0.0


@inline
def find_forces(system, s, v, f):
    """Fill f [contacts], N, with the forces at compressions s and their rates v."""
    for k in range(s.shape[0]):
        f[k] = 0.0
        if not s[k] <= 0.0:
            f[k] = system.stiffness[k] * power(s[k], system.exponent[k]) * max(0.0, 1.0 + system.loss[k] * v[k])


@inline
def find_forces_at(system, q, p, s, v, f):
    """Fill f [contacts], N, with the forces at a state q, p [modes]; s and v are overwritten. Returns whether any
    contact is closed."""
    touching = find_compressions(system, q, s)
    if touching and system.lossy:
        find_velocities(system, p, s, v)
    find_forces(system, s, v, f)
    return touching


@kernel
def find_forces_with_loss(system, matrix, s, v, f):
    """Fill f [contacts], N, with the forces at compressions s, of which the loss sees the velocities v - matrix·f.

    matrix: [contacts, contacts], how much each force slows each contact within the step, m/s per N
    v: [contacts], m/s, velocities without these forces
    By Gauss-Seidel; each contact alone is solved exactly, so that one contact takes one sweep.
    """
    contacts = s.shape[0]
    for k in range(contacts):
        f[k] = 0.0
    for _ in range(200):
        largest, change = 0.0, 0.0
        for k in range(contacts):
            if s[k] > 0.0:
                slowed = v[k]
                for other in range(contacts):
                    if other != k:
                        slowed -= matrix[k, other] * f[other]
                still = system.stiffness[k] * power(s[k], system.exponent[k])
                force = still * (1.0 + system.loss[k] * slowed) / (1.0 + still * system.loss[k] * matrix[k, k])
                force = max(0.0, force)
                change, largest = max(change, abs(force - f[k])), max(largest, force)
                f[k] = force
        if contacts == 1 or not change > 1e-14 * largest:
            return


@inline
def push(system, f, scale, p):
    """p -= scale·Φᵀ·f; scale: [modes], s."""
    for k in range(f.shape[0]):
        if f[k] != 0.0:
            for m in range(p.shape[0]):
                p[m] -= scale[m] * system.shapes[k, m] * f[k]


@inline
def add_stretching(system, q, scale, p):
    """p += scale·(what bodies that stretch do to each mode at q)."""
    for b in range(system.stretch.shape[0]):
        rise = 0.0
        for m in range(q.shape[0]):
            rise += system.stretch[b, m] * q[m] * q[m]
        for m in range(q.shape[0]):
            p[m] -= scale * rise * system.stretch[b, m] * q[m]


@inline
def keep(frame, system, q, p, displacement, q_out, p_out):
    """Store a state [modes] at a sample."""
    displacement[frame] = project(system.pickup, 0, q)
    if q_out.shape[0] > 0:
        for m in range(q.shape[0]):
            q_out[frame, m], p_out[frame, m] = q[m], p[m]


@inline
def add_forces(f, share, force, frame):
    """Add a share of the forces f [contacts] to those of a frame."""
    for k in range(f.shape[0]):
        force[frame, k] += share * f[k]


@kernel
def solve_linear(matrix, vector, n):
    """Solve the first n equations matrix·x = vector by Gauss's elimination with pivots; both are overwritten, and
    vector becomes x."""
    for i in range(n):
        best = i
        for row in range(i + 1, n):
            if abs(matrix[row, i]) > abs(matrix[best, i]):
                best = row
        if best != i:
            for column in range(i, n):
                matrix[i, column], matrix[best, column] = matrix[best, column], matrix[i, column]
            vector[i], vector[best] = vector[best], vector[i]
        for row in range(i + 1, n):
            ratio = matrix[row, i] / matrix[i, i]
            if ratio != 0.0:
                for column in range(i + 1, n):
                    matrix[row, column] -= ratio * matrix[i, column]
                vector[row] -= ratio * vector[i]
    for i in range(n - 1, -1, -1):
        for column in range(i + 1, n):
            vector[i] -= matrix[i, column] * vector[column]
        vector[i] /= matrix[i, i]
