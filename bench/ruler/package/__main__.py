"""`python -m contact_ruler [PROBLEM [FILE.npz METHOD AUTHOR]]`: list the problems, or print the row of a method."""

import sys
from pathlib import Path

from contact_ruler import NAMES, load_problem, read_trajectory, score
from contact_ruler.leader_board import format_row


def main(words: list[str]) -> int:
    """Return the exit code."""
    if len(words) not in (0, 1, 4):
        print(__doc__, file=sys.stderr)
        return 2
    try:
        for name in words[:1] or NAMES:
            problem, reference = load_problem(name)
            sizes = f"{problem.omega.size} modes, {len(problem.stiffness)} contacts, {problem.frames} samples"
            if len(words) < 2:
                print(f"{name:<20} {problem.title}; {sizes}, of which {reference.horizon} can be predicted")
        if len(words) == 4:
            trajectory = read_trajectory(Path(words[1]), problem)
            print(format_row(name, score(problem, reference, trajectory), *words[2:]))
    except ValueError as error:
        print(f"contact_ruler: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
