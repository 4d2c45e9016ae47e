"""Commands about patches and what they may hold: check, params, new, schema, reference."""

import argparse
import difflib
import json
import os
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from engine.cli import arguments
from engine.cli.messages import CommandError, InputError, print_faults, print_result, read_patch, require_scene
from engine.cli.option_checks import DEFAULT_SAMPLERATE
from engine.faults import BuildError, Fault, PatchError
from engine.files import SHIPPED_PATCHES, is_folder, path_exists
from engine.wording import program_name, to_one_line

if TYPE_CHECKING:
    from engine.patch.scene import Scene

TEMPLATES = SHIPPED_PATCHES / "templates"
SCHEMA = SHIPPED_PATCHES / "patch.schema.json"
FIRST_TEMPLATE = "hammer"
LONGEST_PATH = 400  # characters of one in a message
MUCH_LEFT_OUT = 0.25  # of what a body gives way at contacts within a sample: said


def add_patch_commands(commands: "arguments.Commands") -> None:
    """Add the commands of this file and their options."""
    check = arguments.add_command(commands, "check", check_patches, "validate patches without rendering")
    arguments.add_patch(check, nargs="+")
    summary = "list the numbers of a patch and their paths"
    params = arguments.add_command(commands, "params", print_parameters, summary)
    arguments.add_patch(params)
    arguments.add_json(params, "them")
    templates = read_templates()
    listed = "\n".join(f"  {name:<8} {text.splitlines()[0].lstrip('# ')}" for name, text in templates.items())
    formatted = {"epilog": f"templates:\n{listed}", "formatter_class": argparse.RawDescriptionHelpFormatter}
    new = arguments.add_command(commands, "new", start_patch, "start a patch from a template", **formatted)
    new.add_argument("name", metavar="NAME", help="name of the patch; the file is NAME.toml")
    like_help = f"{', '.join(templates)} (default: {FIRST_TEMPLATE})"
    arguments.add_options(new, ("--like", "TEMPLATE", like_help))
    text = "Print the JSON Schema of patches, with which editors complete and check keys."
    summary = "print the JSON Schema of patches, for editors"
    arguments.add_command(commands, "schema", print_schema, summary, description=text)
    text = "Print a description of every patch key as Markdown (docs/patches.md)."
    summary = "print a description of every patch key, as Markdown"
    arguments.add_command(commands, "reference", print_reference, summary, description=text)


def check_patches(args: argparse.Namespace) -> int:
    """Validate patches without rendering: they are read, and built as a render would; returns the exit code."""
    faulty = False
    for path in args.patch:
        scene, faults = read_patch(path)
        notes: list[str] = []
        if scene is not None:
            faults, notes = check_build(path, scene)
        faulty = faulty or bool(faults)
        if scene is not None and not faults:
            names = {"bodies": "body", "contacts": "contact", "forces": "force", "pickups": "pickup"}
            summary = ", ".join(f"{name} {len(getattr(scene, section))}" for name, section in names.items())
            print(f"{to_one_line(path, LONGEST_PATH)}: valid; {summary}")
            for note in notes:
                print(f"  {note}")
        print_faults(faults)
    return 2 if faulty else 0


def check_build(path: str, scene: "Scene") -> tuple[list[Fault], list[str]]:
    """Build a patch at the usual sample rate, and try all keys of an instrument; return the faults that prevent
    rendering, and notes for its author."""
    from engine.analysis.compressed_contacts import find_compressed_contacts
    from engine.analysis.undamped import undamped_modes
    from engine.assembly import limits
    from engine.assembly.build import build
    from engine.assembly.residual_modes import shares_left_out
    from engine.patch.labels import find_unused_labels
    from engine.patch.note_scene import check_all_keys
    from engine.patch.reader import locate_faults

    rate = DEFAULT_SAMPLERATE * scene.accuracy.oversample
    try:
        limits.check_forces(scene, rate, scene.seconds)
        built = build(scene, rate, seconds=0.0)  # with its forces, but not the tables of hours
        check_all_keys(scene)
    except (BuildError, PatchError) as error:
        return locate_faults(path, error.faults), []
    shares = shares_left_out(scene, built.layout.modal_bodies, rate)
    return [], [
        *find_unused_labels(scene),
        *(
            f"{to_one_line(body.name, LONGEST_PATH)} has residual modes at its contacts, in place of modes that are"
            " left out"
            for body, modal in zip(scene.body, built.layout.modal_bodies, strict=True)
            if modal.residual
        ),
        *(
            f"{to_one_line(name, LONGEST_PATH)} lacks {100 * share:.2g}% of what it gives way at its contacts within a"
            " sample, as modes are left out; residual = true replaces it"
            for name, share in shares.items()
            if share >= MUCH_LEFT_OUT
        ),
        *(
            f"{to_one_line(name, LONGEST_PATH)} never decays, because nothing damps {count} of its modes"
            for name, count in undamped_modes(built.layout).items()
        ),
        *(
            f"contact[{number}] begins with a compression of {depth:.3g} m, whose energy is {energy:.3g} J;"
            " if it should not, check the signs of barrier, gap and side"
            for number, (depth, energy) in find_compressed_contacts(built.layout, built.state).items()
        ),
    ]


def print_schema(args: argparse.Namespace) -> int:
    """Print the JSON Schema of a patch; returns the exit code."""
    from engine.patch.json_schema import editor_schema

    readable = (sys.stdout.encoding or "utf-8").lower().replace("-", "") == "utf8"
    print(json.dumps(editor_schema(), indent=1, ensure_ascii=not readable))
    return 0


def print_reference(args: argparse.Namespace) -> int:
    """Print what every key of a patch means; returns the exit code."""
    from engine.patch.reference_page import reference_page

    print(reference_page(), end="")
    return 0


def print_parameters(args: argparse.Namespace) -> int:
    """List the numbers of a patch; returns the exit code."""
    from engine.patch.number_format import format_number
    from engine.patch.parameters import list_parameters
    from engine.report.console import print_table

    scene = require_scene(*read_patch(args.patch))
    parameters = list_parameters(scene)
    rows: list[tuple[str, ...]] = [("path", "value", "unit", "range", "live", "meaning")]
    for p in parameters:
        meaning = f"{p.label}: {p.meaning}" if p.label else p.meaning
        rows.append((p.path, format_number(p.value), p.unit, p.range, "live" if p.live else "", meaning))
    values = {"patch": args.patch, "params": [asdict(p) for p in parameters]}
    print_result(args.json, values, lambda: print_table(rows))
    return 0


def start_patch(args: argparse.Namespace) -> int:
    """Start a patch from a template; returns the exit code."""
    from engine.output_files import error_reason, write_text

    templates = read_templates()
    like, path = args.like or FIRST_TEMPLATE, Path(args.name)
    path = path if path.suffix == ".toml" or not path.name else path.with_name(path.name + ".toml")
    faults = []
    if args.name in ("", "..") or not Path(args.name).name or "\0" in args.name:
        faults.append(Fault("NAME", f'"{args.name}" is not the name of a file; give a word, such as mine'))
        path = Path("none.toml")
    if like not in templates:
        near = difflib.get_close_matches(like, templates, 1, 0.5)
        meant = f'did you mean "{near[0]}"? There are ' if near else ""
        faults.append(Fault("--like", f'no template "{like}"; {meant}{", ".join(templates)}'))
    if path_exists(path):
        faults.append(Fault("", "already exists; give another NAME", str(path)))
    elif not is_folder(path.parent):
        faults.append(Fault("", f"no such folder: {path.parent}; make it, or write elsewhere", str(path)))
    if faults:
        raise InputError(faults)
    try:
        write_text(path, schema_directive(path) + templates[like])
    except OSError as error:
        message = f"cannot write {to_one_line(str(path), LONGEST_PATH)} ({error_reason(error)})"
        raise CommandError(message) from error
    print(
        f"{path}: written from the template {like}"
        + ("" if args.like else f"; other templates for --like: {other_templates(templates, like)}")
    )
    typed = shlex.quote(str(path if path.parts[0][0] != "-" else Path(".") / path))
    print(f"  {start_command()} check {typed}\n  {start_command()} render {typed}")
    return 0


def read_templates() -> dict[str, str]:
    """The texts of all templates, by name."""
    return {path.stem: path.read_text("utf-8") for path in sorted(TEMPLATES.glob("*.toml"))}


def start_command() -> str:
    """Return the command that starts this program from the current folder."""
    script = Path(sys.argv[0])
    if program_name() != "render.py":
        return program_name()
    return f"uv run {script}" if script.parent == Path() else f"uv run --project {script.parent} {script}"


def other_templates(templates: dict[str, str], like: str) -> str:
    """The names of all templates but one."""
    return ", ".join(name for name in templates if name != like)


def schema_directive(path: Path) -> str:
    """The first line of a patch, by which editors find the schema; none if it is not there, or on another drive."""
    try:
        way = os.path.relpath(SCHEMA, path.parent.resolve())
    except ValueError:
        return ""
    way = Path(way).as_posix()
    return f"#:schema {way if way.startswith('.') else './' + way}\n" if SCHEMA.is_file() else ""
