"""The score of a trajectory: how far it is from the reference of its problem."""

import math
from dataclasses import dataclass

import numpy as np

from bench.ruler.contact_ruler.problem import Problem, Reference, energy_of
from bench.ruler.contact_ruler.trajectory import Trajectory, check_trajectory
from engine.analysis.metrics import band_error, relative_rms_error
from engine.offline.statistics_base import Statistics

BLOW_UP_FACTOR = 100.0  # of the reference's peak: beyond, a motion counts as unstable


@dataclass(frozen=True)
class Score(Statistics):
    """Errors of a trajectory against a reference; NaN if an error cannot be measured."""

    motion: float  # error of the displacement up to the horizon, root mean square, share of that of the reference
    force: float  # the same of the force of all contacts together
    bands_db: float  # third-octave band of the velocity that is farthest off
    energy: float  # share of the largest energy: what was created or lost; with loss, what was created
    pull: float  # how strongly a contact pulls at most, share of the largest push; 0 if none ever does
    ns_per_sample: float
    failed: str  # in what way; "" if it did not


def score(problem: Problem, reference: Reference, trajectory: Trajectory) -> Score:
    """The score of a trajectory. Raises UnfitTrajectory if it is not one of this problem."""
    check_trajectory(problem, trajectory)
    nanoseconds = trajectory.seconds / problem.frames * 1e9
    y, known = trajectory.displacement, reference.displacement
    largest = np.abs(known).max()
    if not np.all(np.isfinite(y)) or np.abs(y).max() > BLOW_UP_FACTOR * largest:
        return Score(math.nan, math.nan, math.nan, math.nan, math.nan, nanoseconds, "blows up")
    with np.errstate(over="ignore", invalid="ignore"):  # of absurd forces and energies; what comes out says so
        return _score_finite(problem, reference, trajectory, nanoseconds)


def _score_finite(problem: Problem, reference: Reference, trajectory: Trajectory, nanoseconds: float) -> Score:
    """The score of a trajectory whose displacement is not absurd."""
    y, known, frames = trajectory.displacement, reference.displacement, reference.horizon
    velocity, known_velocity = (np.diff(x)[:, None] * problem.samplerate for x in (y, known))
    return Score(
        motion=relative_rms_error(y[1:, None], known[1:, None], frames),
        force=relative_rms_error(trajectory.force.sum(axis=1)[:, None], reference.force[:, None], frames),
        bands_db=band_error(velocity, known_velocity, problem.samplerate),
        energy=energy_error(problem, reference, trajectory),
        pull=pull_of(trajectory.force[:, : problem.barrier.size]),  # friction has either sign
        ns_per_sample=nanoseconds,
        failed="",
    )


def energy_error(problem: Problem, reference: Reference, trajectory: Trajectory) -> float:
    """The largest change of the energy without loss, or rise with it, share of the largest of the reference; NaN if it
    is not known, or if a surface that rubs supplies energy."""
    if problem.friction is not None:
        return math.nan
    energy = trajectory.energy
    if trajectory.q is not None and trajectory.p is not None:
        energy = energy_of(problem, trajectory.q, trajectory.p)
    if energy is None or not np.all(np.isfinite(energy)):
        return math.nan
    largest = float(np.abs(reference.energy).max())
    if problem.sigma.any() or problem.loss.any():
        return float(np.max(energy - np.minimum.accumulate(energy))) / largest
    return float(np.max(np.abs(energy - energy[0]))) / largest


def pull_of(force: np.ndarray) -> float:
    """The strongest pull of a contact, share of the strongest push [frames, contacts]; NaN without any."""
    if force.shape[1] == 0 or not np.all(np.isfinite(force)):
        return math.nan
    push = float(force.max(initial=0.0))
    pull = max(0.0, -float(force.min(initial=0.0)))
    return pull / push if push > 0.0 else 0.0
