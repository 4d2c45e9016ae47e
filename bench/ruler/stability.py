"""How stiff a contact may be before a method blows up."""

import math
from collections.abc import Callable

import numpy as np

from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.contact_ruler.trajectory import Trajectory

FREQUENCY = 440.0  # Hz
AMPLITUDE = 1e-3  # m, at which the oscillator of 1 kg is let go
BARRIER = 0.5e-3  # m, on the other side
SECONDS = 0.2
SOFTEST, STIFFEST = 1e3, 1e15  # N/m²
GROWTH = 1.5  # of the energy of the start, above which a method is unstable
RESOLUTION = 1.05  # ratio of the stiffnesses between which the limit is trajectory


def meeting_a_barrier(stiffness: float, samplerate: float = 44_100.0) -> Problem:
    """An oscillator of 1 kg that meets a barrier of exponent 2, some 90 times."""
    one = np.ones(1)
    return Problem(
        title="an oscillator of 440 Hz meets a barrier",
        samplerate=samplerate,
        frames=round(SECONDS * samplerate),
        omega=2.0 * math.pi * FREQUENCY * one,
        sigma=0.0 * one,
        weight=0.0 * one,
        q=-AMPLITUDE * one,
        p=0.0 * one,
        shapes=np.ones((1, 1)),
        barrier=BARRIER * one,
        stiffness=stiffness * one,
        exponent=2.0 * one,
        loss=0.0 * one,
        pickup=one,
    )


def is_stable(simulate: Callable[[Problem, int], Trajectory], stiffness: float) -> bool:
    """Whether the oscillator keeps below 1.5 times the energy it begins with, in one time step per sample.

    Its own energy, without the barrier's: a method that lets it sink in for a sample is not unstable as long as what
    that stores is not given to it.
    """
    problem = meeting_a_barrier(stiffness)
    with np.errstate(all="ignore"):
        trajectory = simulate(problem, 1)
        q = trajectory.displacement[:, None] if trajectory.q is None else trajectory.q
        p = np.zeros_like(q) if trajectory.p is None else trajectory.p
        energy = np.sum(0.5 * p**2 + 0.5 * problem.omega**2 * q**2, axis=1)
        return bool(np.all(energy <= GROWTH * energy[0]))  # not if it is not a number


def largest_stable_stiffness(simulate: Callable[[Problem, int], Trajectory]) -> float:
    """The largest stiffness up to which a method is stable, N/m², to 5 %: inf if the stiffest is, 0 if none is."""
    stable, unstable = 0.0, SOFTEST
    while is_stable(simulate, unstable):
        if unstable >= STIFFEST:
            return math.inf
        stable, unstable = unstable, 10.0 * unstable
    while stable > 0.0 and unstable / stable > RESOLUTION:
        middle = math.sqrt(stable * unstable)
        stable, unstable = (middle, unstable) if is_stable(simulate, middle) else (stable, middle)
    return stable
