"""`python -m contact_ruler [PROBLEM [FILE.npz [METHOD AUTHOR]]]`: list the problems, measure the errors of a
trajectory, or print its row of the leader board."""

import sys
from pathlib import Path

from bench.ruler.contact_ruler import NAMES, load_problem, read_trajectory, score
from bench.ruler.contact_ruler.leader_board import format_row


def main(words: list[str]) -> int:
    """Return the exit code."""
    if len(words) not in (0, 1, 2, 4):
        print(__doc__, file=sys.stderr)
        return 2
    try:
        for name in words[:1] or NAMES:
            problem, reference = load_problem(name)
            sizes = f"{problem.omega.size} modes, {len(problem.stiffness)} contacts, {problem.frames} samples"
            if len(words) < 2:
                print(f"{name:<20} {problem.title}; {sizes}, of which {reference.horizon} can be predicted")
        if len(words) > 1:
            result = score(problem, reference, read_trajectory(Path(words[1]), problem))
            rows = [f"{key:<14} {value:.4g}" for key, value in result.as_dict().items() if key != "failed"]
            print(format_row(name, result, *words[2:]) if words[2:] else "\n".join([*rows, result.failed]).rstrip())
    except ValueError as error:
        print(f"contact_ruler: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
