"""The command `accuracy`: errors and costs of a patch at a ladder of settings."""

import argparse
import json
import sys
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import print_error, print_faults, read_patch
from engine.cli.option_checks import (
    check_paths,
    check_rate_and_channels,
    numeric_options,
    plot_path,
    report_path,
    samplerate_of,
    sound_path,
)
from engine.faults import Fault
from engine.output_files import check_audio_format
from engine.wording import json_safe

# the sound of a report is rendered as the patch says it
AS_THE_PATCH_SAYS = {
    "trace": None,
    "trace_shapes": None,
    "target_error": None,
    "subtype": None,
    "gain": None,
    "cores": None,
    "error_estimate": None,
}


def add_accuracy_command(commands: "arguments.Commands") -> None:
    """Add `accuracy` and its options."""
    summary = "compare the errors and costs of accuracy settings"
    description = f"{summary.capitalize()} for a patch."
    parser = commands.add_parser("accuracy", help=summary, description=description)
    arguments.add_patch(parser)
    arguments.add_length_and_rate(parser)
    arguments.add_plot(parser, "error against computation time")
    arguments.add_report(parser, "the comparison and a rendering, whose sound is also written")
    output_help = "sound file of the --report (default: PATCH.wav in this folder)"
    parser.add_argument("-o", "--output", metavar="OUT.wav", help=output_help)
    arguments.add_json(parser, "the comparison")
    parser.set_defaults(run=accuracy_command, kernel=None, **AS_THE_PATCH_SAYS)


def accuracy_command(args: argparse.Namespace) -> int:
    """Print error and time of accuracy settings, and plot or report them if an option says so; return the exit code."""
    from engine.cli import rendering
    from engine.report import console, work_precision_plot

    scene, faults = read_patch(args.patch)
    numbers, option_faults = numeric_options(args)
    sound = None if args.report is None else sound_path(args)
    option_faults += check_paths({"--output": sound, "--plot": plot_path(args), "--report": report_path(args)})
    if sound is not None:
        option_faults += check_audio_format(sound, None, "--output")
        if scene is not None and not option_faults:
            channels = scene.channels
            option_faults += check_rate_and_channels("--output", sound, samplerate_of(numbers), channels)
    elif args.output is not None:
        option_faults.append(Fault("--output", "requires --report; give that too"))
    faults += option_faults
    if scene is None or faults:
        print_faults(faults)
        return 2
    plot, outputs, companions = plot_path(args), None, list[Path]()
    try:
        study = rendering.run_work_precision(scene, numbers["seconds"], numbers, args)
        if args.report is not None:
            outputs = rendering.render_from_arguments(scene, numbers, args, study)
            companions = rendering.write_outputs(outputs, args)
        elif plot is not None:
            name, style = Path(args.patch).stem, args.plot_style or "screen"
            draw = lambda path: work_precision_plot.plot_work_precision(study, name, path, style)
            rendering.write_or_raise(plot, draw)
    except MemoryError:
        print_error("there is not enough memory for so many samples; give fewer --seconds")
        return 1
    except rendering.WriteError as error:
        print_error(error)
        return 1
    for warning in outputs.warnings if outputs is not None else []:
        print(warning, file=sys.stderr)
    if args.json:
        printed = outputs.stats if outputs is not None else {"patch": args.patch}
        print(json.dumps(json_safe(printed | {"price": study.as_dict()})))
        return 0
    console.print_work_precision(study)
    if outputs is not None:
        console.print_summary(outputs.stats, [str(path) for path in companions])
    elif plot is not None:
        print(plot)
    return 0
