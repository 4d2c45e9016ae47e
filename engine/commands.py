"""What the command line does besides rendering: check, describe and start patches, and the cache."""

import argparse
import difflib
import json
import os
import sys
from collections.abc import Sized
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from engine.arguments import Parser
from engine.feedback import finite
from engine.files import is_folder, there
from engine.wording import one_line

if TYPE_CHECKING:
    from engine.patch import Fault
    from engine.scene import Scene

TEMPLATES = Path(__file__).parent / "templates"
SCHEMA = Path(__file__).parent.parent / "patches" / "patch.schema.json"
FIRST = "hammer"
RATE = 44_100  # Hz, if no other is asked for
PATH, LONGEST = 400, 20  # characters of a path that is told, and of a word that may be a command


def check(words: list[str]) -> int:
    """Validate patches without rendering: they are read, and built as a render would."""
    parse = Parser(prog="render.py check", description="Validate patches without rendering.")
    parse.add_argument("patch", nargs="+", metavar="PATCH")
    faulty = False
    for path in parse.parse_args(words).patch:
        scene, faults = read(path)
        if scene is not None:
            faults = unbuilt(path, scene)
        faulty = faulty or bool(faults)
        if scene is not None and not faults:
            parts: dict[str, Sized] = {
                "bodies": scene.body,
                "contacts": scene.contact,
                "forces": scene.force,
                "pickups": scene.pickup,
            }
            told = ", ".join(f"{name} {len(tables)}" for name, tables in parts.items())
            print(f"{one_line(path, PATH)}: good; {told}")
        report(faults)
    return 2 if faulty else 0


def read(path: str) -> "tuple[Scene | None, list[Fault]]":
    """A patch, or its faults."""
    from engine.patch import PatchError, load

    try:
        return load(path), []
    except PatchError as error:
        return None, error.faults


def unbuilt(path: str, scene: "Scene") -> "list[Fault]":
    """What stands against rendering a patch at the usual sample rate."""
    from engine import limits
    from engine.build import BuildError, build
    from engine.patch import located

    rate = RATE * scene.accuracy.oversample
    try:
        limits.forces(scene, rate, scene.seconds)
        build(scene, rate, seconds=0.0)  # with its forces, but not the tables of hours
    except BuildError as error:
        return located(path, error.faults)
    return []


def report(faults: "list[Fault]") -> None:
    """One line each, on standard error."""
    for fault in faults:
        print(fault, file=sys.stderr)


def schema(words: list[str]) -> int:
    """Print the JSON Schema of a patch."""
    from engine.describe import schema as described

    Parser(
        prog="render.py schema", description="Print the JSON Schema of a patch, by which editors complete and check."
    ).parse_args(words)
    readable = (sys.stdout.encoding or "utf-8").lower().replace("-", "") == "utf8"
    print(json.dumps(described(), indent=1, ensure_ascii=not readable))
    return 0


def reference(words: list[str]) -> int:
    """Print what every key of a patch means."""
    from engine.describe import reference as described

    Parser(
        prog="render.py reference", description="Print every key of a patch, as Markdown: docs/patches.md."
    ).parse_args(words)
    print(described(), end="")
    return 0


def params(words: list[str]) -> int:
    """List the numbers of a patch."""
    from engine.describe import short
    from engine.params import params as numbers
    from engine.tell import columns

    parse = Parser(prog="render.py params", description="List the numbers of a patch, by their paths.")
    parse.add_argument("patch", metavar="PATCH")
    parse.add_argument("--json", action="store_true", help="print them as one JSON object")
    args = parse.parse_args(words)
    scene, faults = read(args.patch)
    if scene is None:
        report(faults)
        return 2
    found = numbers(scene)
    if args.json:
        print(json.dumps(finite({"patch": args.patch, "params": [asdict(p) for p in found]})))
        return 0
    rows: list[tuple[str, ...]] = [("path", "value", "unit", "range", "live", "meaning")]
    rows += [(p.path, short(p.value), p.unit, p.range, "knob" if p.live else "", p.meaning) for p in found]
    columns(rows)
    return 0


def new(words: list[str]) -> int:
    """Start a patch from a template."""
    from engine.patch import Fault
    from engine.save import reason, replaced

    templates = {path.stem: path.read_text("utf-8") for path in sorted(TEMPLATES.glob("*.toml"))}
    told = "\n".join(f"  {name:<8} {text.splitlines()[0].lstrip('# ')}" for name, text in templates.items())
    parse = Parser(
        prog="render.py new",
        description="Start a patch from a template.",
        epilog=f"templates:\n{told}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parse.add_argument("name", metavar="NAME", help="the patch to write, NAME.toml")
    parse.add_argument("--like", metavar="TEMPLATE", help=f"{', '.join(templates)} (default: {FIRST})")
    args = parse.parse_args(words)
    like, path = args.like or FIRST, Path(args.name)
    path = path if path.suffix == ".toml" or not path.name else path.with_name(path.name + ".toml")
    faults = []
    if args.name in ("", "..") or not Path(args.name).name or "\0" in args.name:
        faults.append(Fault("render.py", None, "NAME", f'"{args.name}" names no file; a word, such as mine'))
        path = Path("none.toml")
    if like not in templates:
        near = difflib.get_close_matches(like, templates, 1, 0.5)
        right = f'did you mean "{near[0]}"?' if near else ""
        faults.append(Fault("render.py", None, "--like", f'no template "{like}"; {right or ", ".join(templates)}'))
    if there(path):
        faults.append(Fault(str(path), None, "", "exists; give another NAME"))
    elif not is_folder(path.parent):
        faults.append(Fault(str(path), None, "", f"no such folder: {path.parent}; make it, or write elsewhere"))
    if faults:
        report(faults)
        return 2
    try:
        with replaced(path) as part:
            part.write_text(_directive(path) + templates[like], "utf-8")
    except OSError as error:
        print(f"render.py: cannot write {one_line(str(path), PATH)} ({reason(error)})", file=sys.stderr)
        return 1
    print(f"{path}: like {like}" + ("" if args.like else f"; --like also knows {_others(templates, like)}"))
    print(f"  {_program()} check {path}\n  {_program()} {path}")
    return 0


def cache(words: list[str]) -> int:
    """Tell where compiled kernels are kept, and delete them."""
    from engine import kernel_files

    parse = Parser(prog="render.py cache", description="Tell where compiled kernels are kept, and how large they are.")
    parse.add_argument("--clear", action="store_true", help="delete them; a render compiles again what it needs")
    parse.add_argument("--json", action="store_true", help="print the same as one JSON object")
    args = parse.parse_args(words)
    try:
        limit = kernel_files.limit()
        base = kernel_files.folder()
    except ValueError as error:
        print(f"render.py: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"render.py: compiled kernels are not kept ({error})", file=sys.stderr)
        return 1
    before = kernel_files.files(base)
    left = kernel_files.clear(base) if args.clear else before
    kernels, size = kernel_files.count(left)
    deleted = kernel_files.count(before)[0] - kernels
    told = {"folder": str(base), "kernels": kernels, "bytes": size, "limit_bytes": limit, "deleted": deleted}
    if args.json:
        print(json.dumps(finite(told)))
    elif args.clear:
        print(f"{base}: {deleted} kernels deleted")
    else:
        print(f"{base}: {kernels} kernels, {size / 1e6:.1f} MB; at most {limit / 1e6:g} MB")
    if args.clear and left:
        print(f"render.py: {len(left)} files in {base} cannot be deleted", file=sys.stderr)
        return 1
    return 0


def _program() -> str:
    """How this program is run, from here."""
    program = Path(sys.argv[0])
    if program.name != "render.py":
        return "render.py"
    return f"uv run {program}" if program.parent == Path() else f"uv run --project {program.parent} {program}"


def _others(templates: dict[str, str], like: str) -> str:
    return ", ".join(name for name in templates if name != like)


def _directive(path: Path) -> str:
    """The first line of a patch, by which editors find the schema; none if it is not there, or on another drive."""
    try:
        way = os.path.relpath(SCHEMA, path.parent.resolve())
    except ValueError:
        return ""
    way = Path(way).as_posix()
    return f"#:schema {way if way.startswith('.') else './' + way}\n" if SCHEMA.is_file() else ""


def misspelt(word: str, commands: list[str]) -> str | None:
    """The command that was meant by a word that names no file."""
    if word in commands or not word.isalpha() or len(word) > LONGEST or Path(word).exists():
        return None
    return next(iter(difflib.get_close_matches(word, commands, 1, 0.6)), None)
