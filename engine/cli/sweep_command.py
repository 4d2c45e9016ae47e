"""The command `sweep`: a patch rendered at many values of its keys, into a folder with an index."""

import argparse
import json

from engine.cli import arguments
from engine.cli.messages import print_error, print_faults, read_patch
from engine.cli.option_checks import accuracy_options, numeric_options
from engine.cli.progress import progress_feedback
from engine.output_files import error_reason


def add_sweep_command(commands: "arguments.Commands") -> None:
    """Add `sweep` and its options."""
    parser = commands.add_parser(
        "sweep",
        help="render a patch for many parameter values, or many notes",
        description="Render a patch for many parameter values, or many notes, into a folder with an index.csv.",
    )
    arguments.add_patch(parser)
    parser.add_argument(
        "--vary",
        metavar="PATH=RANGE",
        action="append",
        default=[],
        help="contact.felt.stiffness=1e8..1e10:log:16, or PATH=A..B:N, PATH=A,B,C; several options make a grid",
    )
    parser.add_argument("--random", metavar="N", help="render N random points instead of the grid")
    parser.add_argument("--seed", metavar="S", help="random seed for --random (default: 0)")
    text = "render notes: A0..C8, every third key A0..C8/3, or C2,F#3,A4"
    parser.add_argument("--notes", metavar="KEYS", help=text)
    text = "velocities of each note: a number of layers up to 127, or a list 40,80,127 (default: 80)"
    parser.add_argument("--velocities", metavar="N", help=text)
    parser.add_argument("--hold", metavar="S", help="time for which keys are held, in seconds (default: 4)")
    parser.add_argument("--sfz", action="store_true", help="also write PATCH.sfz, for samplers")
    text = "folder to write (default: PATCH in this folder)"
    parser.add_argument("-o", "--output", metavar="FOLDER", help=text)
    arguments.add_length_and_rate(parser)
    arguments.add_sound_format(parser)
    arguments.add_gain(parser)
    arguments.add_cores(parser)
    parser.add_argument("--cluster", metavar="ADDRESS", help="render on the workers of a Dask scheduler")
    arguments.add_accuracy_options(parser)
    arguments.add_json(parser, "the result")
    parser.set_defaults(run=sweep_command)


def sweep_command(args: argparse.Namespace) -> int:
    """Render variations of a patch; returns the exit code."""
    from engine.report import console
    from engine.sweep import plan as sweep_plan
    from engine.sweep import sweep

    scene, faults = read_patch(args.patch)
    numbers, option_faults = numeric_options(args)
    option_faults += sweep_plan.check_output(args)
    if scene is not None:
        plan, plan_faults = sweep_plan.plan_sweep(args, scene, {} if option_faults else numbers)
        option_faults += plan_faults
    faults += option_faults
    if scene is None or faults:
        print_faults(faults)
        return 2
    folder = sweep_plan.sweep_folder(args)
    try:
        with progress_feedback("rendering the sweep") as progress:
            accuracy = accuracy_options(args)
            outcome = sweep.sweep_from_arguments(plan, folder, numbers, accuracy, args.subtype, args.cluster, progress)
        if args.sfz and not outcome.interrupted:
            outcome.sfz = sweep.write_note_map(plan, folder)
    except (OSError, RuntimeError) as error:
        print_error(f"cannot write to {folder} ({error_reason(error)})" if isinstance(error, OSError) else error)
        return 1
    print(json.dumps(outcome.as_dict(folder))) if args.json else console.print_sweep(outcome.as_dict(folder))
    return outcome.exit_code
