"""The command `replay`: what was played live is rendered again from its log, bit for bit."""

import argparse
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import InputError, print_messages, print_result, write_file
from engine.cli.option_checks import check_rate_and_channels, read_paths
from engine.cli.progress import progress_feedback
from engine.output_files import check_audio_format, error_reason, save_audio


def add_replay_command(commands: "arguments.Commands") -> None:
    """Add `replay` and its options."""
    text = "Render a live performance bit for bit from the log that play --event-log wrote."
    summary = "render a live performance from its log"
    parser = arguments.add_command(commands, "replay", replay_command, summary, description=text)
    parser.add_argument("log", metavar="LOG.json", help="log that play --event-log wrote")
    text = "sound file to write (default: LOG_replay.wav in this folder)"
    parser.add_argument("-o", "--output", metavar="OUT.wav", help=text)
    arguments.add_options(parser, "--subtype")
    arguments.add_json(parser, "name and length of the file")


def replay_command(args: argparse.Namespace) -> int:
    """Render a log; returns the exit code."""
    from engine.faults import Fault
    from engine.live.replay import read_log, replay

    args.output = args.output or f"{Path(args.log).stem}_replay.wav"
    faults = read_paths(args, "--output") + check_audio_format(args.output, args.subtype, "--output")
    warnings: list[str] = []
    try:
        log = read_log(Path(args.log))
        channels = log.made().channels
        faults += check_rate_and_channels("--output", args.output, log.samplerate, channels)
        if not faults:
            with progress_feedback("replaying") as progress:
                audio = replay(log, progress, warnings.append)
    except (OSError, ValueError, RecursionError, MemoryError) as error:
        reason = error_reason(error).splitlines()[0] if str(error) else "too long"
        faults.append(Fault("", f"cannot be read as a log ({reason}); give one that play --event-log wrote", args.log))
    if faults:
        raise InputError(faults)
    print_messages(f"{args.log}: {warning}" for warning in warnings)
    write_file(args.output, lambda path: save_audio(path, audio, log.samplerate, args.subtype))
    stats = {"output": str(args.output), "samplerate": log.samplerate, "seconds": len(audio) / log.samplerate}
    print_result(args.json, stats, lambda: print(args.output))
    return 0
