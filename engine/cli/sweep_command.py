"""The command `sweep`: a patch rendered at many values of its keys, into a folder with an index."""

import argparse

from engine.cli import arguments
from engine.cli.messages import CommandError, print_messages, print_result, read_patch, require_scene
from engine.cli.option_checks import read_options, sound_form
from engine.cli.progress import progress_feedback
from engine.output_files import error_reason


def add_sweep_command(commands: "arguments.Commands") -> None:
    """Add `sweep` and its options."""
    summary = "render a patch for many parameter values, or many notes"
    text = f"{summary.capitalize()}, into a folder with an index.csv."
    parser = arguments.add_command(commands, "sweep", sweep_command, summary, description=text)
    arguments.add_patch(parser)
    text = "contact.felt.stiffness=1e8..1e10:log:16, or PATH=A..B:N, PATH=A,B,C; several options make a grid"
    parser.add_argument("--vary", metavar="PATH=RANGE", action="append", default=[], help=text)
    count = "--random", "N", "render N random points instead of the grid"
    text = "render N variations, whose values are drawn as [vary] of the patch says"
    variations = "--variations", "N", text
    seed = "--seed", "S", "random seed for --random and --variations (default: that of [vary], or 0)"
    notes = "--notes", "KEYS", "render notes: A0..C8, every third key A0..C8/3, or C2,F#3,A4"
    text = "velocities of each note: a number of layers up to 127, or a list 40,80,127 (default: 80)"
    hold = "--hold", "S", "time for which keys are held, in seconds (default: 4)"
    arguments.add_options(parser, count, variations, seed, notes, ("--velocities", "N", text), hold)
    parser.add_argument("--sfz", action="store_true", help="also write PATCH.sfz, for samplers")
    text = "also write index.html, which shows and plays all sounds"
    parser.add_argument("--sheet", action="store_true", help=text)
    text = "folder to write (default: PATCH in this folder)"
    parser.add_argument("-o", "--output", metavar="FOLDER", help=text)
    text = "names of the sounds, such as Bowl_{number:02}_{rim.velocity}: fields are number, patch and what varies"
    arguments.add_options(parser, ("--name", "TEMPLATE", text))
    text = "also measure each contact: first touch, duration, impulse, largest force and compression, touches"
    parser.add_argument("--contacts", action="store_true", help=text)
    cluster = "--cluster", "ADDRESS", "render on the workers of a Dask scheduler"
    arguments.add_options(parser, "--seconds", "--samplerate", "--subtype", "--gain", "--cores", cluster)
    arguments.add_sound_options(parser)
    arguments.add_accuracy_options(parser)
    arguments.add_json(parser, "the result")


def sweep_command(args: argparse.Namespace) -> int:
    """Render variations of a patch; returns the exit code."""
    from engine.report import console
    from engine.sweep import plan as sweep_plan
    from engine.sweep import sweep
    from engine.sweep.contact_sheet import write_contact_sheet

    scene, faults = read_patch(args.patch)
    option_faults = read_options(args)
    option_faults += sweep_plan.check_output(args, scene)
    if scene is not None:
        plan, plan_faults = sweep_plan.plan_sweep(args, scene, {} if option_faults else vars(args))
        option_faults += plan_faults
    require_scene(scene, faults + option_faults)
    print_messages(f"note: {line}" for line in plan.left_out)
    folder, form = sweep_plan.sweep_folder(args), sound_form(args)
    try:
        with progress_feedback("rendering the sweep") as progress:
            outcome = sweep.sweep_from_arguments(plan, folder, args, form, progress)
        if args.sheet and not outcome.interrupted:
            title = scene.title if scene and scene.title else folder.name
            outcome.sheet = write_contact_sheet(folder, title, [axis.path for axis in plan.axes])
        if args.sfz and not outcome.interrupted:
            outcome.sfz = sweep.write_note_map(plan, folder, form.loop is not None)
    except (OSError, RuntimeError) as error:
        message = f"cannot write to {folder} ({error_reason(error)})" if isinstance(error, OSError) else error
        raise CommandError(message) from error
    print_messages(outcome.warnings)
    values = outcome.as_dict(folder)
    print_result(args.json, values, lambda: console.print_sweep(values))
    return outcome.exit_code
