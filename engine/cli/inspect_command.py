"""The command `inspect`: what a patch is built of, what is left out, and what each part costs."""

import argparse
import json
from typing import TYPE_CHECKING

from engine.cli import arguments
from engine.cli.messages import print_error, print_faults, read_patch
from engine.cli.option_checks import accuracy_options, numeric_options, samplerate_of, scene_of_key
from engine.cli.progress import progress_feedback
from engine.wording import json_safe

if TYPE_CHECKING:
    from engine.patch.scene import Scene


def add_inspect_command(commands: "arguments.Commands") -> None:
    """Add `inspect` and its options."""
    summary = "show the coupled subsystems and effects of a scene, and their costs"
    description = f"{summary.capitalize()}. No file is written. An island is a coupled subsystem: bodies that are"
    description += " joined, directly or through others, by contacts and connections, and are solved together."
    parser = commands.add_parser("inspect", help=summary, description=description)
    arguments.add_patch(parser)
    arguments.add_length_and_rate(parser)
    arguments.add_accuracy_options(parser)
    arguments.add_key(parser, "instead, print every number of one key of an instrument")
    arguments.add_json(parser, "the result")
    parser.set_defaults(run=profile_command)


def profile_command(args: argparse.Namespace) -> int:
    """Print what a scene is made of, and what it costs; returns the exit code."""
    from engine.analysis.profile import profile_scene
    from engine.report import console

    scene, faults = read_patch(args.patch)
    numbers, option_faults = numeric_options(args)
    _, key_faults = scene_of_key(scene, args)
    faults += option_faults + key_faults
    if scene is None or faults:
        print_faults(faults)
        return 2
    if args.key is not None:
        return print_key(scene, args)
    seconds = numbers["seconds"] or scene.seconds
    try:
        with progress_feedback("measuring costs") as progress:
            profile = profile_scene(scene, seconds, samplerate_of(numbers), progress, **accuracy_options(args))
    except MemoryError:
        print_error("there is not enough memory for so many samples; give fewer --seconds")
        return 1
    if args.json:
        print(json.dumps({"patch": args.patch, "seconds": seconds, "explain": json_safe(profile.as_dict())}))
    else:
        console.print_profile(profile, seconds)
    return 0


def print_key(scene: "Scene", args: argparse.Namespace) -> int:
    """Print every number that an instrument has at a key; returns the exit code."""
    from engine.instrument.expansion import parse_key_of
    from engine.instrument.listing import format_listing, list_key
    from engine.instrument.tables import DEFAULT_VELOCITY

    document = scene.instrument or {}
    listing = list_key(document, parse_key_of(document, args.key), int(args.velocity or DEFAULT_VELOCITY))
    if args.json:
        print(json.dumps({"patch": args.patch} | json_safe(listing)))
    else:
        print("\n".join(format_listing(listing)))
    return 0
