"""Problems of collision with reference solutions, and the score of a trajectory against them (docs/ruler.md)."""

from bench.ruler.contact_ruler.library import NAMES, load_problem
from bench.ruler.contact_ruler.problem import Friction, Problem, Reference, energy_of, stretching_force
from bench.ruler.contact_ruler.score import Score, score
from bench.ruler.contact_ruler.trajectory import Trajectory, UnfitTrajectory, read_trajectory

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
