"""The command `score`: how far a trajectory of any method is from the reference of a problem of collision."""

import argparse
import json
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import print_error
from engine.output_files import atomic_write, error_reason
from engine.wording import json_safe


def add_score_command(commands: "arguments.Commands") -> None:
    """Add `score` and its options."""
    summary = "measure the error of a trajectory against the reference of a collision problem"
    parser = commands.add_parser(
        "score",
        help=summary,
        description=f"{summary.capitalize()}. Without PROBLEM, list the problems (docs/ruler.md).",
    )
    parser.add_argument("problem", metavar="PROBLEM", nargs="?", help="name of the problem")
    parser.add_argument(
        "trajectory", metavar="TRAJECTORY.npz", nargs="?", help="displacement, force, and q and p or energy"
    )
    parser.add_argument("-o", "--output", metavar="PROBLEM.npz", help="write the arrays of the problem to this file")
    arguments.add_json(parser, "the result")
    parser.set_defaults(run=score_command)


def score_command(args: argparse.Namespace) -> int:
    """List the problems, write one, or score a trajectory; returns the exit code."""
    from engine import problems

    if fault := explain_output(args):
        print_error(f"--output: {fault}")
        return 2
    if args.problem is None:
        return list_problems(args.json)
    try:
        problem, reference = problems.load_problem(args.problem)
        if args.trajectory is not None:
            result = problems.score(problem, reference, problems.read_trajectory(Path(args.trajectory), problem))
            print_values(result.as_dict(), args.json)
    except ValueError as error:
        print_error(error)
        return 2
    if args.trajectory is None:
        print_values(describe(args.problem), args.json)
    return 0 if args.output is None else copy_problem(args.problem, Path(args.output))


def explain_output(args: argparse.Namespace) -> str:
    """Explain why --output cannot be written; return "" if it can, or is not given."""
    if args.output is None:
        return ""
    if args.problem is None:
        return "no problem is given; give its name"
    if args.trajectory is not None:
        return "the arrays of a problem are written without a trajectory"
    if not args.output.lower().endswith(".npz"):
        return f'"{args.output}" is not the name of an .npz file; end it in .npz'
    return ""


def describe(name: str) -> dict[str, object]:
    """Describe a problem: its title, sizes and horizon, by names."""
    from engine import problems

    problem, reference = problems.load_problem(name)
    return {
        "problem": name,
        "title": problem.title,
        "modes": problem.omega.size,
        "contacts": len(problem.stiffness),
        "frames": problem.frames,
        "samplerate": problem.samplerate,
        "horizon": reference.horizon,
        "agreement": max(reference.agreement, reference.other_agreement),
    }


def list_problems(as_json: bool) -> int:
    """Print all problems; returns the exit code."""
    from engine import problems
    from engine.report.console import print_table

    rows = [describe(name) for name in problems.NAMES]
    if as_json:
        print(json.dumps(json_safe(rows)))
    else:
        print_table([tuple(rows[0]), *(tuple(_as_text(value) for value in row.values()) for row in rows)])
    return 0


def print_values(values: dict[str, object], as_json: bool) -> None:
    """Print values with their names."""
    from engine.report.console import print_table

    if as_json:
        print(json.dumps(json_safe(values)))
    else:
        print_table([(name, _as_text(value)) for name, value in values.items()])


def copy_problem(name: str, path: Path) -> int:
    """Write the file of a problem elsewhere; returns the exit code."""
    from engine.problems.library import problem_path

    try:
        with atomic_write(path) as part:
            part.write_bytes(problem_path(name).read_bytes())
    except (OSError, ValueError) as error:
        print_error(f"--output: {path} cannot be written ({error_reason(error)})")
        return 1
    return 0


def _as_text(value: object) -> str:
    """A value as a line of a table has it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
