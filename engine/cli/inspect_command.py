"""The command `inspect`: what a patch is built of, what is left out, and what each part costs."""

import argparse
from typing import TYPE_CHECKING

from engine.cli import arguments
from engine.cli.messages import memory_errors_explained, print_messages, print_result, read_patch, require_scene
from engine.cli.option_checks import read_options, samplerate_of, scene_of_key
from engine.cli.progress import progress_feedback

if TYPE_CHECKING:
    from engine.patch.scene import Scene


def add_inspect_command(commands: "arguments.Commands") -> None:
    """Add `inspect` and its options."""
    summary = "show the coupled subsystems and effects of a scene, and their costs"
    description = f"{summary.capitalize()}. No file is written. An island is a coupled subsystem: bodies that are"
    description += " joined, directly or through others, by contacts and connections, and are solved together."
    parser = arguments.add_command(commands, "inspect", profile_command, summary, description=description)
    arguments.add_patch(parser)
    arguments.add_options(parser, "--seconds", "--samplerate")
    arguments.add_accuracy_options(parser)
    key = "--key", "KEY", "instead, print every number of one key of an instrument"
    arguments.add_options(parser, key, "--velocity")
    arguments.add_json(parser, "the result")


def profile_command(args: argparse.Namespace) -> int:
    """Print what a scene is made of, and what it costs; returns the exit code."""
    from engine.analysis.profile import profile_scene
    from engine.report import console

    scene, faults = read_patch(args.patch)
    option_faults = read_options(args)
    _, key_faults = scene_of_key(scene, args)
    scene = require_scene(scene, faults + option_faults + key_faults)
    if args.key is not None:
        return print_key(scene, args)
    seconds = args.seconds or scene.seconds
    with memory_errors_explained("give fewer --seconds"), progress_feedback("measuring costs") as progress:
        profile = profile_scene(scene, seconds, samplerate_of(args), progress, **args.accuracy)
    values = {"patch": args.patch, "seconds": seconds, "explain": profile.as_dict()}
    print_result(args.json, values, lambda: console.print_profile(profile, seconds))
    print_messages(f"{args.patch}: {warning}" for warning in profile.warnings)
    return 0


def print_key(scene: "Scene", args: argparse.Namespace) -> int:
    """Print every number that an instrument has at a key; returns the exit code."""
    from engine.instrument.expansion import parse_key_of
    from engine.instrument.listing import format_listing, list_key
    from engine.instrument.tables import DEFAULT_VELOCITY

    document = scene.instrument or {}
    listing = list_key(document, parse_key_of(document, args.key), int(args.velocity or DEFAULT_VELOCITY))
    print_result(args.json, {"patch": args.patch} | listing, lambda: print("\n".join(format_listing(listing))))
    return 0
