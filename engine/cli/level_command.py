"""The command `level`: the gain at which the loudest note of a patch peaks at half of full scale."""

import argparse
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from engine.cli import arguments
from engine.cli.messages import InputError, memory_errors_explained, print_faults, print_result, read_patch
from engine.cli.option_checks import check_kernel, read_options, samplerate_of
from engine.cli.progress import progress_feedback
from engine.faults import BuildError, PatchError

if TYPE_CHECKING:
    from engine.patch.scene import Scene


def add_level_command(commands: "arguments.Commands") -> None:
    """Add `level` and its options."""
    summary = "measure the level of patches: the gain at which the loudest note peaks at -6 dBFS"
    description = (
        f"{summary[0].upper()}{summary[1:]}. Of an instrument, each key is played alone at velocity 127; another patch"
        " plays by itself. What is printed, level = …, is for the top of the patch."
    )
    parser = arguments.add_command(commands, "level", level_command, summary, description=description)
    arguments.add_patch(parser, nargs="+")
    arguments.add_options(parser, "--samplerate", "--kernel")
    arguments.add_json(parser, "the levels")


def level_command(args: argparse.Namespace) -> int:
    """Measure the levels of patches; returns the exit code."""
    from engine.patch.reader import locate_faults

    if faults := read_options(args) + check_kernel(args):
        raise InputError(faults)
    measured, is_faulty = list[dict[str, Any]](), False
    for path in args.patch:
        scene, faults = read_patch(path)
        if scene is not None:
            try:
                measured.append(level_of(path, scene, args))
            except (BuildError, PatchError) as error:
                faults = locate_faults(path, error.faults)
            else:
                if not args.json:
                    print(describe_level(measured[-1]), flush=True)
        is_faulty |= bool(faults)
        print_faults(faults)
    print_result(args.json, {"patches": measured}, lambda: None)
    return 2 if is_faulty else 0


def level_of(path: str, scene: "Scene", args: argparse.Namespace) -> dict[str, Any]:
    """Measure the level of a patch, as `--json` prints it: of a silent one, only what the patch gives."""
    from engine.api.level import measure_level

    with memory_errors_explained("take a patch with fewer modes"), progress_feedback(f"measuring {path}"):
        level = measure_level(scene, samplerate_of(args), args.kernel)
    return {"patch": path, "given": scene.level} | (asdict(level) if level is not None else {"level": None})


def describe_level(values: dict[str, Any]) -> str:
    """The level of a patch as a line of the patch, with a comment on the one that it gives now."""
    if values["level"] is None:
        return f"{values['patch']}: silent"
    notes = [f"{values['loudest']} is the loudest key"] if values["loudest"] else []
    if values["given"] is not None:
        peak = values["given"] + 20 * math.log10(values["peak"])
        notes.append(f"at {values['given']:g}, as the patch has it, the peak is {peak:.1f} dBFS")
    return f"{values['patch']}: level = {values['level']:.1f}" + (f"  # {'; '.join(notes)}" if notes else "")
