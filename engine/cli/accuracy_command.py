"""The command `accuracy`: errors and costs of a patch at a ladder of settings."""

import argparse

from engine.cli import arguments
from engine.cli.messages import (
    memory_errors_explained,
    print_messages,
    print_result,
    read_patch,
    require_scene,
    write_file,
)
from engine.cli.option_checks import check_rate_and_channels, read_options, read_paths, samplerate_of
from engine.faults import Fault
from engine.output_files import check_audio_format

# options of `render` that its report does without: the sound is rendered as the patch says it
AS_THE_PATCH_SAYS = (
    "film",
    "trace",
    "trace_shapes",
    "target_error",
    "subtype",
    "gain",
    "cores",
    "error_estimate",
    "kernel",
)


def add_accuracy_command(commands: "arguments.Commands") -> None:
    """Add `accuracy` and its options."""
    summary = "compare the errors and costs of accuracy settings"
    description = f"{summary.capitalize()} for a patch."
    parser = arguments.add_command(commands, "accuracy", accuracy_command, summary, description=description)
    arguments.add_patch(parser)
    arguments.add_options(parser, "--seconds", "--samplerate")
    arguments.add_plot(parser, "error against computation time")
    arguments.add_report(parser, "the comparison and a rendering, whose sound is also written")
    output_help = "sound file of the --report (default: PATCH.wav in this folder)"
    parser.add_argument("-o", "--output", metavar="OUT.wav", help=output_help)
    arguments.add_json(parser, "the comparison")
    parser.set_defaults(**dict.fromkeys(AS_THE_PATCH_SAYS))


def accuracy_command(args: argparse.Namespace) -> int:
    """Print error and time of accuracy settings, and plot or report them if an option says so; return the exit code."""
    from engine.cli import rendering
    from engine.report import console

    scene, faults = read_patch(args.patch)
    option_faults = read_options(args)
    has_sound = args.report is not None
    option_faults += read_paths(args, *(["--output"] if has_sound else []), "--plot", "--report")
    if has_sound:
        option_faults += check_audio_format(args.output, None, "--output")
        if scene is not None and not option_faults:
            option_faults += check_rate_and_channels("--output", args.output, samplerate_of(args), scene.channels)
    elif args.output is not None:
        option_faults.append(Fault("--output", "requires --report; give that too"))
    scene = require_scene(scene, faults + option_faults)
    stats, companions = {"patch": args.patch}, list[str]()
    with memory_errors_explained("give fewer --seconds"):
        study = rendering.run_work_precision(scene, args.seconds, args)
        if has_sound:
            outputs = rendering.render_from_arguments(scene, args, study)
            if outputs.is_interrupted:  # the page would lack what it is for
                raise KeyboardInterrupt
            stats, companions = outputs.stats, outputs.write()
            print_messages(outputs.warnings)
        elif args.plot is not None:
            write_file(args.plot, lambda path: rendering.plot_comparison(study, path, args))

    def print_text() -> None:
        console.print_work_precision(study)
        if has_sound:
            console.print_summary(stats, companions)
        elif args.plot is not None:
            print(args.plot)

    print_result(args.json, stats | {"price": study.as_dict()}, print_text)
    return 0
