"""The command `score`: how far a trajectory of any method is from the reference of a problem of collision."""

import argparse
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import CommandError, print_result
from engine.output_files import atomic_write, error_reason


def add_score_command(commands: "arguments.Commands") -> None:
    """Add `score` and its options."""
    summary = "measure the error of a trajectory against the reference of a collision problem"
    text = f"{summary.capitalize()}. Without PROBLEM, list the problems (docs/ruler.md)."
    parser = arguments.add_command(commands, "score", score_command, summary, description=text)
    parser.add_argument("problem", metavar="PROBLEM", nargs="?", help="name of the problem")
    text = "displacement, force, and q and p or energy"
    parser.add_argument("trajectory", metavar="TRAJECTORY.npz", nargs="?", help=text)
    parser.add_argument("-o", "--output", metavar="PROBLEM.npz", help="write the arrays of the problem to this file")
    arguments.add_json(parser, "the result")


def score_command(args: argparse.Namespace) -> int:
    """List the problems, write one, or score a trajectory; returns the exit code."""
    from engine import problems
    from engine.report.console import print_table

    if fault := explain_output(args):
        raise CommandError(f"--output: {fault}", 2)
    if args.problem is None:
        rows = [describe(name) for name in problems.NAMES]
        cells = [tuple(rows[0]), *(tuple(map(_as_text, row.values())) for row in rows)]
        print_result(args.json, rows, lambda: print_table(cells))
        return 0
    try:
        problem, reference = problems.load_problem(args.problem)
        if args.trajectory is None:
            values = describe(args.problem)
        else:
            trajectory = problems.read_trajectory(Path(args.trajectory), problem)
            values = problems.score(problem, reference, trajectory).as_dict()
    except ValueError as error:
        raise CommandError(error, 2) from error
    print_result(args.json, values, lambda: print_table([(name, _as_text(v)) for name, v in values.items()]))
    if args.output is not None:
        copy_problem(args.problem, Path(args.output))
    return 0


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


def copy_problem(name: str, path: Path) -> None:
    """Write the file of a problem elsewhere. Raises CommandError."""
    from engine.problems.library import problem_path

    try:
        with atomic_write(path) as part:
            part.write_bytes(problem_path(name).read_bytes())
    except (OSError, ValueError) as error:
        raise CommandError(f"--output: {path} cannot be written ({error_reason(error)})") from error


def _as_text(value: object) -> str:
    """A value as a line of a table has it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
