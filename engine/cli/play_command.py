"""The command `play`: live sound. What plays is in `live_session`, which takes longer to import."""

import argparse
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import CommandError, require_scene
from engine.cli.option_checks import (
    check_kernel,
    check_parts,
    check_rate_and_channels,
    parse_latency,
    read_options,
    read_paths,
)
from engine.cli.tuning_options import add_tuning_options, read_tuned_patch
from engine.faults import Fault
from engine.live.osc import parse_address
from engine.output_files import check_audio_format, error_reason

BLOCK_SIZE = "256"  # frames, unless told otherwise
MAX_BLOCK_SIZE = 65_536  # frames
CALLBACKS = "compiled", "python"


def add_play_command(commands: "arguments.Commands") -> None:
    """Add `play` and its options."""
    text = "Play a patch live; Ctrl-C or q ends it."
    parser = arguments.add_command(commands, "play", live_command, "play a patch live", description=text)
    arguments.add_patch(parser)
    text = "number of the output device, or part of its name (see the command devices)"
    arguments.add_options(parser, ("--device", "NAME", text))
    text = "frames per audio block (default: %(default)s)"
    parser.add_argument("--block-size", metavar="N", default=BLOCK_SIZE, help=text)
    latency = "--latency", "L", "low, high, or seconds (default: that of the device)"
    rate = "--samplerate", "HZ", "sample rate in Hz (default: that of the device)"
    midi = "--midi", "PORT|FILE", "play the notes of a MIDI file, or of a MIDI port"
    voices = "--voices", "N", f"maximum number of notes at a time, with --midi or --osc (default: {arguments.VOICES})"
    gain = (
        "--gain",
        "DB",
        "gain in dB, applied to SI units (default: the level of the patch, or else measured)",
    )
    arguments.add_options(parser, latency, "--seconds", rate, gain, "--cores", "--kernel", midi)
    text = "receive Open Sound Control on this UDP port; only from this machine unless HOST is given"
    arguments.add_options(parser, "--channels", "--tracks", "--tempo", voices, ("--osc", "[HOST:]PORT", text))
    text = "with --midi FILE: follow the MIDI clock of this port, with start, stop, continue and places in the song"
    arguments.add_options(parser, ("--clock", "PORT", text))
    add_tuning_options(parser)
    parser.add_argument("--watch", action="store_true", help="reload the patch whenever it is saved")
    text = "also record the sound to this file; or, if it ends in .mid, what a MIDI port plays; repeat it for both"
    parser.add_argument("--record", metavar="OUT.wav", action="append", default=[], help=text)
    log = "--event-log", "LOG.json", "also write a log of all events, for the command replay"
    arguments.add_options(parser, "--subtype", log)
    text = "play even if the patch is too slow for real time"
    parser.add_argument("--ignore-speed", action="store_true", help=text)
    text = "compiled (default), or python, for comparison"
    parser.add_argument("--callback", metavar="KIND", default=CALLBACKS[0], help=text)
    arguments.add_accuracy_options(parser)
    arguments.add_json(parser)
    parser.instead = dict.fromkeys(("-o", "--output"), "--record OUT.wav records the sound")


def live_command(args: argparse.Namespace) -> int:
    """Play a patch; returns the exit code."""
    scene, faults = read_tuned_patch(args.patch, args)
    option_faults = read_options(args)
    option_faults += read_recordings(args)
    option_faults += read_paths(args, "--record", "--record-midi", "--event-log")
    option_faults += check_audio_format(args.record or Path("none.wav"), args.subtype, "--record")
    if scene is not None and not option_faults and args.record is not None and args.samplerate is not None:
        channels = scene.channels  # without a rate, it is the device's own
        option_faults += check_rate_and_channels("--record", args.record, args.samplerate, channels)
    scene = require_scene(scene, faults + option_faults + read_play_options(args) + check_kernel(args))

    from engine.cli import live_session
    from engine.live.audio_device import DeviceError

    try:
        return live_session.play_patch(args, scene)
    except DeviceError as error:
        raise CommandError(error) from error
    except OSError as error:
        raise CommandError(f"cannot write the recording ({error_reason(error)})") from error


def read_recordings(args: argparse.Namespace) -> list[Fault]:
    """Divide the names of recordings into those of the sound and of the notes, in place; list their faults."""
    from engine.live.midi_files import MIDI_ENDINGS, is_midi_file

    ends = {name: Path(name).suffix.lower() in MIDI_ENDINGS for name in args.record}
    files = {is_notes: [name for name in args.record if ends[name] == is_notes] for is_notes in (False, True)}
    faults = [
        Fault("--record", f"{names[0]} and {names[1]} are both given; give one sound file, and one .mid")
        for names in files.values()
        if len(names) > 1
    ]
    args.record, args.record_midi = (names[0] if names else None for names in files.values())
    if args.record_midi is not None and (not args.midi or is_midi_file(args.midi)):
        faults.append(Fault("--record", f"{args.record_midi} has what a MIDI port plays; give --midi PORT"))
    return faults


def read_play_options(args: argparse.Namespace) -> list[Fault]:
    """Turn the block size and the latency into numbers, in place; list the faults of all options of live sound."""
    faults: list[Fault] = []
    if args.block_size.isdecimal() and 1 <= int(args.block_size) <= MAX_BLOCK_SIZE:
        args.block_size = int(args.block_size)
    else:
        what = f'"{args.block_size}" is not a block size; give 1 to {MAX_BLOCK_SIZE} frames'
        faults.append(Fault("--block-size", what))
    try:
        args.latency = parse_latency(args.latency)
    except ValueError:
        faults.append(Fault("--latency", f'"{args.latency}" is not a latency; give low, high, or seconds'))
    if args.callback not in CALLBACKS:
        faults.append(Fault("--callback", f'"{args.callback}" is not a callback; give {" or ".join(CALLBACKS)}'))
    try:
        parse_address(args.osc or "0")
    except ValueError:
        faults.append(Fault("--osc", f'"{args.osc}" is not a port; give 1 to 65535, or HOST:PORT such as 0.0.0.0:9000'))
    if args.voices is not None and not args.midi and args.osc is None:
        faults.append(Fault("--voices", "requires --midi or --osc; give one of them"))
    from engine.live.midi_files import is_midi_file

    if args.clock is not None and not (args.midi and is_midi_file(args.midi)):
        faults.append(Fault("--clock", "requires --midi with a file; give that too"))
    elif args.clock is not None and args.tempo is not None:
        faults.append(Fault("--clock", "sets the tempo; leave out --tempo"))
    return faults + check_parts(args)
