"""The problems by their names."""

import difflib
from pathlib import Path

from bench.ruler.contact_ruler.problem import Problem, Reference, read_problem

FOLDER = Path(__file__).parent / "references"
VERSION = "1.2"  # of the problems and references: rises with any change of their numbers
NAMES = (  # simple to hard
    "barrier",
    "repelled_oscillator",
    "bouncing_ball",
    "lossy_bounce",
    "walls",
    "hammer_c2",
    "hammer_c4",
    "stretching_string",
    "bowed_string",
    "joined",
    "drum",
    "snare",
    "tanpura",
    "frets",
)


def load_problem(name: str) -> tuple[Problem, Reference]:
    """A problem and its reference. Raises ValueError if there is none of that name."""
    if name not in NAMES:
        near = difflib.get_close_matches(name, NAMES, 1)
        raise ValueError(f'no problem is called "{name}"; {f"did you mean {near[0]}?" if near else ", ".join(NAMES)}')
    return read_problem(problem_path(name))


def problem_path(name: str) -> Path:
    """The file of a problem."""
    return FOLDER / f"{name}.npz"
