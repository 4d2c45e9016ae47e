"""The command `export`: a patch that sounds without Python."""

import argparse
import sys
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import CommandError, memory_errors_explained, print_result, read_patch, require_scene
from engine.cli.option_checks import read_options, samplerate_of
from engine.faults import Fault
from engine.output_files import error_reason

NATIVE = "x86_64-linux"


def add_export_command(commands: "arguments.Commands") -> None:
    """Add `export` and its options."""
    summary = "write a patch as a library in C, which sounds without Python"
    description = f"{summary.capitalize()}. Its kernel is compiled for the patch, which takes half a minute."
    parser = arguments.add_command(commands, "export", export_command, summary, description=description)
    arguments.add_patch(parser)
    arguments.add_options(
        parser,
        ("--c", "FOLDER", "folder of the library; it is made if it is not there"),
        ("--target", "NAME", f"machine that it is for, such as aarch64-linux (default: {NATIVE})"),
        "--seconds",
        "--samplerate",
    )
    arguments.add_json(parser, "the names of the files")


def export_command(args: argparse.Namespace) -> int:
    """Write the library of a patch; returns the exit code."""
    from engine.export.c_library import export_c
    from engine.export.machine_code import TARGETS

    scene, faults = read_patch(args.patch)
    faults += read_options(args)
    target = args.target or NATIVE
    if args.c is None:
        faults.append(Fault("--c", "give the folder of the library, such as --c my_patch"))
    elif not Path(args.c).absolute().parent.is_dir():
        faults.append(Fault("--c", f"{args.c}: the folder that it would be in is not there"))
    if target not in TARGETS:
        faults.append(Fault("--target", f"no target is called {target!r}; there are {', '.join(TARGETS)}"))
    scene = require_scene(scene, faults)
    with memory_errors_explained("give fewer --seconds"):
        try:
            written = export_c(scene, Path(args.c), target, args.seconds, samplerate_of(args))
        except OSError as error:
            raise CommandError(f"{args.c}: {error_reason(error)}") from None
    if not TARGETS[target].is_tested:
        print(f"note: no {target} machine was at hand to test its code", file=sys.stderr)
    values = {"patch": args.patch, "target": target, "files": [str(path) for path in written]}
    print_result(args.json, values, lambda: print(f"wrote {args.c}: {', '.join(path.name for path in written)}"))
    return 0
