"""The options that give an instrument another tuning."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from engine.cli import arguments
from engine.cli.messages import read_patch
from engine.faults import Fault, PatchError

if TYPE_CHECKING:
    from engine.patch.scene import Scene

OPTIONS = {"tuning": "--tuning", "keyboard_map": "--keyboard-map"}


def add_tuning_options(parser: arguments.CommandParser) -> None:
    """Add --tuning and --keyboard-map."""
    scale = "--tuning", "FILE.scl", "tune an instrument to the scale of a Scala file"
    keys = "--keyboard-map", "FILE.kbm", "keys of the degrees of the scale; keys that it leaves out are silent"
    arguments.add_options(parser, scale, keys)


def is_tuned(args: argparse.Namespace) -> bool:
    """True if the options give a tuning."""
    return args.tuning is not None or args.keyboard_map is not None


def tune(scene: "Scene", args: argparse.Namespace) -> "Scene":
    """Return a patch that was read while it plays, such as an edited one, tuned as the options say. Raises
    ValueError."""
    if is_tuned(args) and scene.has_keys:
        return scene.with_tuning(args.tuning, args.keyboard_map)
    return scene


def read_tuned_patch(path: str, args: argparse.Namespace) -> "tuple[Scene | None, list[Fault]]":
    """Read a patch, tuned as the options say; returns its scene, or the faults of both."""
    scene, faults = read_patch(path)
    if scene is None or not is_tuned(args):
        return scene, faults
    from engine.patch.tuning_files import TuningError

    try:
        return scene.with_tuning(args.tuning, args.keyboard_map), []
    except TuningError as error:
        return None, [Fault(OPTIONS[error.key], f"{error.message}; {error.remedy}")]
    except ValueError as error:
        if isinstance(error, PatchError):
            return None, error.faults
        option = OPTIONS["tuning" if args.tuning is not None else "keyboard_map"]
        return None, [Fault(option, f"{Path(path).name}: {error}")]
