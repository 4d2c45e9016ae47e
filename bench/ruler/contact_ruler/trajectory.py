"""The result of a method for a problem, and its files."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.ruler.contact_ruler.problem import Problem


class Trajectory(NamedTuple):
    """The result of a method for a problem (problem.py)."""

    displacement: np.ndarray  # [frames + 1], m, at the pickup, from time 0 on
    force: np.ndarray  # [frames, contacts + points of friction], N: the mean over each sample
    q: np.ndarray | None = None  # [frames + 1, modes], √kg·m; with p, the energy is that of the continuous system
    p: np.ndarray | None = None  # [frames + 1, modes], √kg·m/s
    seconds: float = float("nan")  # that it took, on one core
    energy: np.ndarray | None = None  # [frames + 1], J: instead of q and p, that of the continuous system


class UnfitTrajectory(ValueError):
    """A file or a trajectory that a problem cannot be scored by; the message says why."""


def read_trajectory(path: Path, problem: Problem) -> Trajectory:
    """A trajectory from an .npz file that has the arrays of Trajectory by their names. Raises UnfitTrajectory."""
    values = _read_arrays(path)
    if unknown := sorted(set(values) - set(Trajectory._fields)):
        raise UnfitTrajectory(f"{path}: unknown array {unknown[0]}; known are {', '.join(Trajectory._fields)}")
    if "displacement" not in values:
        raise UnfitTrajectory(f"{path}: has no array displacement [frames + 1], m")
    values.setdefault("force", np.full((problem.frames, problem.force_count), np.nan))
    seconds = values.pop("seconds", np.array(np.nan))
    if seconds.dtype.kind not in "iuf" or seconds.size != 1:
        raise UnfitTrajectory(f"{path}: seconds is not a number")
    trajectory = Trajectory(**values, seconds=float(seconds.item()))
    check_trajectory(problem, trajectory)
    return trajectory


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an .npz file by their names. Raises UnfitTrajectory."""
    try:
        with path.open("rb") as file:
            if file.read(2) != b"PK":
                raise ValueError("no archive of arrays")
            file.seek(0)
            with np.load(file, allow_pickle=False) as data:
                values = {name: data[name] for name in data.files}
    except Exception as error:  # a damaged archive makes zipfile, zlib and NumPy raise almost anything
        reason = " ".join(str(getattr(error, "strerror", None) or error).split()) or type(error).__name__
        raise UnfitTrajectory(f"{path}: cannot be read as .npz ({reason})") from None
    for name, array in values.items():
        if not isinstance(array, np.ndarray):  # NumPy hands on what is no array as bytes
            raise UnfitTrajectory(f"{path}: {name} is not an array")
    return values


def check_trajectory(problem: Problem, trajectory: Trajectory) -> None:
    """Raises UnfitTrajectory if an array has another shape than the problem asks for, or no numbers."""
    frames, modes, forces = problem.frames, problem.omega.size, problem.force_count
    shapes: dict[str, tuple[int, ...]] = {"displacement": (frames + 1,), "force": (frames, forces)}
    shapes |= {"q": (frames + 1, modes), "p": (frames + 1, modes), "energy": (frames + 1,)}
    for name, shape in shapes.items():
        array = getattr(trajectory, name)
        if array is None:
            continue
        if np.shape(array) != shape:
            raise UnfitTrajectory(f"{name} is {list(np.shape(array))}; the shape must be {list(shape)}")
        if not np.issubdtype(np.asarray(array).dtype, np.floating):
            raise UnfitTrajectory(f"{name} is of type {np.asarray(array).dtype}; it must be of floating-point numbers")
    if (trajectory.q is None) != (trajectory.p is None):
        raise UnfitTrajectory("q without p, or p without q; both are needed for the energy")
