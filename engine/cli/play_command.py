"""The command `play`: live sound. What plays is in `live_session`, which takes longer to import."""

import argparse
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import print_error, print_faults, read_patch
from engine.cli.option_checks import (
    accuracy_options,
    check_kernel,
    check_parts,
    check_paths,
    check_rate_and_channels,
    numeric_options,
    optional_path,
    parse_latency,
    samplerate_of,
)
from engine.faults import Fault
from engine.live.osc import parse_address
from engine.output_files import check_audio_format, error_reason

BLOCK_SIZE = "256"  # frames, unless told otherwise
MAX_BLOCK_SIZE = 65_536  # frames
CALLBACKS = "compiled", "python"


def add_play_command(commands: "arguments.Commands") -> None:
    """Add `play` and its options."""
    text = "Play a patch live; Ctrl-C or q ends it."
    parser = commands.add_parser("play", help="play a patch live", description=text)
    arguments.add_patch(parser)
    parser.add_argument(
        "--device", metavar="NAME", help="number of the output device, or part of its name (see the command devices)"
    )
    text = "frames per audio block (default: %(default)s)"
    parser.add_argument("--block-size", metavar="N", default=BLOCK_SIZE, help=text)
    parser.add_argument("--latency", metavar="L", help="low, high, or seconds (default: that of the device)")
    arguments.add_length_and_rate(parser, "that of the device")
    arguments.add_gain(parser)
    arguments.add_cores(parser)
    arguments.add_kernel(parser)
    parser.add_argument("--midi", metavar="PORT|FILE", help="play the notes of a MIDI file, or of a MIDI port")
    arguments.add_parts(parser)
    arguments.add_voices(parser, "--midi or --osc")
    text = "receive Open Sound Control on this UDP port; only from this machine unless HOST is given"
    parser.add_argument("--osc", metavar="[HOST:]PORT", help=text)
    parser.add_argument("--watch", action="store_true", help="reload the patch whenever it is saved")
    parser.add_argument("--record", metavar="OUT.wav", help="also record the sound to this file")
    arguments.add_sound_format(parser)
    parser.add_argument(
        "--event-log", metavar="LOG.json", help="also write a log of all events, for the command replay"
    )
    text = "play even if the patch is too slow for real time"
    parser.add_argument("--ignore-speed", action="store_true", help=text)
    text = "compiled (default), or python, for comparison"
    parser.add_argument("--callback", metavar="KIND", default=CALLBACKS[0], help=text)
    arguments.add_accuracy_options(parser)
    arguments.add_json(parser)
    parser.set_defaults(run=live_command)
    parser.instead = dict.fromkeys(("-o", "--output"), "--record OUT.wav records the sound")


def live_command(args: argparse.Namespace) -> int:
    """Play a patch; returns the exit code."""

    scene, faults = read_patch(args.patch)
    numbers, option_faults = numeric_options(args)
    record = optional_path(args.record)
    option_faults += check_paths({"--record": record, "--event-log": optional_path(args.event_log)})
    option_faults += check_audio_format(record or Path("none.wav"), args.subtype, "--record")
    if scene is not None and not option_faults and record is not None and args.samplerate is not None:
        channels = scene.channels  # without a rate, it is the device's own
        option_faults += check_rate_and_channels("--record", record, samplerate_of(numbers), channels)
    faults += option_faults + check_play_options(args) + check_kernel(args)
    if scene is None or faults:
        print_faults(faults)
        return 2

    from engine.cli import live_session
    from engine.live.audio_device import DeviceError

    try:
        return live_session.play_patch(args, scene, numbers["gain"], accuracy_options(args))
    except DeviceError as error:
        print_error(error)
        return 1
    except OSError as error:
        print_error(f"cannot write the recording ({error_reason(error)})")
        return 1


def check_play_options(args: argparse.Namespace) -> list[Fault]:
    """List the faults of the options of live sound."""
    faults: list[Fault] = []
    if not args.block_size.isdecimal() or not 1 <= int(args.block_size) <= MAX_BLOCK_SIZE:
        what = f'"{args.block_size}" is not a block size; give 1 to {MAX_BLOCK_SIZE} frames'
        faults.append(Fault("--block-size", what))
    try:
        parse_latency(args.latency)
    except ValueError:
        faults.append(Fault("--latency", f'"{args.latency}" is not a latency; give low, high, or seconds'))
    if args.callback not in CALLBACKS:
        faults.append(Fault("--callback", f'"{args.callback}" is not a callback; give {" or ".join(CALLBACKS)}'))
    try:
        parse_address(args.osc or "0")
    except ValueError:
        faults.append(Fault("--osc", f'"{args.osc}" is not a port; give 1 to 65535, or HOST:PORT such as 0.0.0.0:9000'))
    for option, text in (("--midi", args.midi), ("--event-log", args.event_log)):
        if args.watch and text:
            faults.append(Fault("--watch", f"cannot be combined with {option}; give one of them"))
    if args.voices is not None and not args.midi and args.osc is None:
        faults.append(Fault("--voices", "requires --midi or --osc; give one of them"))
    return faults + check_parts(args)
