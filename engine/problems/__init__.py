"""Problems of collision with reference solutions, and the score of a trajectory against them (docs/ruler.md)."""

from engine.problems.library import NAMES, load_problem
from engine.problems.problem import Friction, Problem, Reference, energy_of, stretching_force
from engine.problems.score import Score, score
from engine.problems.trajectory import Trajectory, UnfitTrajectory, read_trajectory

__all__ = [
    "NAMES",
    "Friction",
    "Problem",
    "Reference",
    "Score",
    "Trajectory",
    "UnfitTrajectory",
    "energy_of",
    "load_problem",
    "read_trajectory",
    "score",
    "stretching_force",
]
