"""Commands about this machine: devices that can be played on, compiled kernels, recordings that were broken off."""

import argparse
import os
import sys
from pathlib import Path

from engine.cli import arguments
from engine.cli.messages import CommandError, InputError, print_result
from engine.faults import Fault


def add_machine_commands(commands: "arguments.Commands") -> None:
    """Add the commands of this file and their options."""
    arguments.add_command(commands, "devices", list_devices, "list the audio output devices and the MIDI ports")
    summary = "show where compiled kernels are stored, and their size"
    cache = arguments.add_command(commands, "cache", cache_command, summary)
    cache.add_argument("--clear", action="store_true", help="delete them; later renders compile what they need again")
    arguments.add_json(cache, "the result")
    summary = "recover interrupted recordings"
    text = f"{summary.capitalize()} as playable files, and delete other unfinished files that are older than a week."
    recover = arguments.add_command(commands, "recover", recover_recordings, summary, description=text)
    folder_help = "folder of the recordings (default: this folder)"
    recover.add_argument("folder", metavar="FOLDER", nargs="?", default=".", help=folder_help)


def list_devices(args: argparse.Namespace) -> int:
    """List what can be played on; returns the exit code."""
    from engine.live.audio_device import DeviceError, output_devices
    from engine.live.midi_drivers import MidiError, list_ports

    try:
        ports, reason = list_ports(), "none"
    except MidiError as error:  # sound needs none
        ports, reason = [], str(error)
    try:
        devices = output_devices()
    except DeviceError as error:
        raise CommandError(error) from error
    for number, name, channels, rate in devices:
        print(f"{number:>3}  {name}: {channels} channels, {rate} Hz")
    for port in ports:
        print(f"MIDI  {port}")
    if not devices:
        print("there is no output device; rendering to a file does not need one", file=sys.stderr)
    if not ports:
        print(f"MIDI ports: {reason}", file=sys.stderr)
    return 0 if devices else 1


def cache_command(args: argparse.Namespace) -> int:
    """Print where compiled kernels are stored, or delete them; return the exit code."""
    from engine.compiler import cache_files

    try:
        limit = cache_files.limit()
        base = cache_files.folder()
    except ValueError as error:
        raise CommandError(error, 2) from error
    except OSError as error:
        raise CommandError(f"compiled kernels are not stored ({error})") from error
    before = cache_files.files(base)
    left = cache_files.clear(base) if args.clear else before
    kernels, size = cache_files.count(left)
    deleted = cache_files.count(before)[0] - kernels
    report = {"folder": str(base), "kernels": kernels, "bytes": size, "limit_bytes": limit, "deleted": deleted}
    text = f"{base}: {kernels} kernels, {size / 1e6:.1f} MB; at most {limit / 1e6:g} MB"
    print_result(args.json, report, lambda: print(f"{base}: {deleted} kernels deleted" if args.clear else text))
    if args.clear and left:
        raise CommandError(f"{len(left)} files in {base} cannot be deleted")
    return 0


def recover_recordings(args: argparse.Namespace) -> int:
    """Keep recordings that were broken off; returns the exit code."""
    from engine.live import recovery
    from engine.live.audio_recording import repair_header
    from engine.output_files import error_reason, unused_path

    folder, count = Path(args.folder), 0
    if not folder.is_dir():
        raise InputError([Fault("FOLDER", f"no such folder: {folder}")])
    try:
        leftovers = recovery.find_leftovers(folder)
        for path, name in leftovers:
            if frames := repair_header(path):
                target = unused_path(folder / name)
                os.replace(path, target)
                count += 1
                print(f"{target}: {frames} frames, recovered from {path.name}")
    except OSError as error:
        raise CommandError(f"cannot recover {folder} ({error_reason(error)})") from error
    deleted = recovery.delete_unusable([(path, name) for path, name in leftovers if path.exists()])
    if deleted:
        print(f"{deleted} other unfinished files, older than a week, deleted")
    if not count:
        print(f"{folder}: there is no interrupted recording")
    return 0
