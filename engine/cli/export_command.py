"""The command `export`: a patch that sounds without Python."""

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.cli import arguments
from engine.cli.messages import CommandError, memory_errors_explained, print_result, require_scene
from engine.cli.option_checks import read_options, samplerate_of
from engine.cli.tuning_options import add_tuning_options, read_tuned_patch
from engine.export.faults import CannotExport
from engine.faults import Fault
from engine.files import is_shipped
from engine.output_files import error_reason, to_utf8_text, write_text

if TYPE_CHECKING:
    from engine.patch.scene import Scene

NATIVE = "x86_64-linux"
KERNELS = ("general", "special")
OF_PLUGIN = {
    "--format": "format",
    "--rates": "rates",
    "--system": "system",
    "--dpf": "dpf",
}  # options, each with its attribute


def add_export_command(commands: "arguments.Commands") -> None:
    """Add `export` and its options."""
    summary = "write a patch as a page that plays in any browser, as a plug-in, or as a library in C"
    description = (
        f"{summary[0].upper()}{summary[1:]}. A page is one HTML file, which computes the sound itself and needs no"
        " network. A plug-in is for programs for music. A library needs a C compiler."
    )
    parser = arguments.add_command(commands, "export", export_command, summary, description=description)
    arguments.add_patch(parser)
    parser.add_argument("-o", "--output", metavar="PAGE", help="file of the page (default: PATCH.html)")
    parser.add_argument(
        "--kernel",
        metavar="NAME",
        help="general, or special, which is compiled for the patch in a minute (default: general)",
    )
    parser.add_argument(
        "--slide",
        metavar="PARAMETER",
        action="append",
        default=[],
        help="of a page: give a live parameter such as body.string.frequency a slider, with tables for each of its"
        " positions, or an instrument its pitch wheel (bend); repeat it for more",
    )
    arguments.add_options(
        parser,
        ("--voices", "N", "of a page: a keyboard on which a patch that is no instrument plays so many notes at a time"),
        (
            "--plugin",
            "FOLDER",
            "write plug-ins to a folder, which is made if it is not there, such as ~/.clap or ~/.lv2",
        ),
        ("--format", "NAME", "of a plug-in: clap, lv2 or vst3 (default: as the folder is called, or clap and lv2)"),
        ("--rates", "44100,48000", "of a plug-in: sample rates that it has tables for (default: 44100,48000,96000)"),
        ("--system", "NAME", "of a plug-in: linux, linux-aarch64, windows, macos, this or all (default: this)"),
        ("--dpf", "FOLDER", "of a plug-in of VST3: sources of DPF (default: those of Debian's dpf-source)"),
        ("--c", "FOLDER", "write a library to a folder, which is made if it is not there"),
        ("--target", "NAME", f"of a library: machine that it is for, such as aarch64-linux (default: {NATIVE})"),
        "--seconds",
        "--samplerate",
    )
    add_tuning_options(parser)
    arguments.add_json(parser, "the names of the files")


def export_command(args: argparse.Namespace) -> int:
    """Write the page or the library of a patch; returns the exit code."""
    scene, faults = read_tuned_patch(args.patch, args)
    find_faults, export = _choose_form(args)
    scene = require_scene(scene, [*faults, *read_options(args), *find_faults(args)])
    try:
        return export(args, scene)
    except CannotExport as error:
        raise CommandError(f"{args.patch}: {error}", 2) from None


def _choose_form(args: argparse.Namespace) -> "tuple[Callable[..., list[Fault]], Callable[..., int]]":
    """Return what finds the faults of the options of a form, and what writes it: a library, a plug-in or a page."""
    if args.c:
        return _faults_of_library, _export_library
    return (_faults_of_plugin, _export_plugin) if args.plugin else (_faults_of_page, _export_page)


def _faults_of_others(args: argparse.Namespace, names: Mapping[str, str], why: str) -> list[Fault]:
    """Return a fault for each option that another form has. names: of options, each with its attribute"""
    return [Fault(option, why) for option, name in names.items() if getattr(args, name) not in (None, [])]


# --- a page


def page_path(args: argparse.Namespace) -> Path:
    """Return the file of a page."""
    return Path(args.output or f"{Path(args.patch).stem}.html")


def _faults_of_kernel(name: str | None) -> list[Fault]:
    if name is None or name in KERNELS:
        return []
    return [Fault("--kernel", f"no kernel is called {name!r}; there are {' and '.join(KERNELS)}")]


def _faults_of_page(args: argparse.Namespace) -> list[Fault]:
    faults, path = _faults_of_kernel(args.kernel), page_path(args)
    if path.suffix.lower() not in (".html", ".htm"):
        faults.append(Fault("-o", f"{path}: a page is an .html file"))
    if not path.absolute().parent.is_dir():
        faults.append(Fault("-o", f"{path}: the folder is not there"))
    of_library = {"--target": "target", "--seconds": "seconds"}
    faults += _faults_of_others(args, of_library, "a page takes none; it is an option of a library (--c FOLDER)")
    return faults + _faults_of_others(
        args, OF_PLUGIN, "a page takes none; it is an option of a plug-in (--plugin FOLDER)"
    )


def _export_page(args: argparse.Namespace, scene: "Scene") -> int:
    from engine.api.page import export_page

    path, command = page_path(args), shlex.join(["fdh", "export", *_words(args)])
    text = Path(args.patch).read_text("utf-8-sig")
    with memory_errors_explained("take a patch with fewer modes"):
        page = export_page(
            scene, samplerate_of(args), args.kernel or KERNELS[0], text, command, args.slide, args.voices or 0
        )
    try:
        write_text(path, to_utf8_text(page.html))
    except OSError as error:
        raise CommandError(f"{path}: {error_reason(error)}") from None
    size = len(page.html.encode())
    values: dict[str, Any] = {"patch": args.patch, "output": str(path), "bytes": size, "policy": page.policy}
    print_result(args.json, values, lambda: print(f"wrote {path} ({size / 1e3:.0f} kB); open it in a browser"))
    return 0


def _words(args: argparse.Namespace) -> list[str]:
    """Return the words that make the page again."""
    output = None if args.output is None else Path(args.output).name  # no folder of its maker: it may be published
    given = {"-o": output, "--kernel": args.kernel, "--samplerate": args.samplerate, "--voices": args.voices}
    options = [(name, str(value)) for name, value in given.items() if value is not None]
    options += [("--slide", parameter) for parameter in args.slide]
    patch = Path(args.patch)
    return [patch.stem if is_shipped(patch) else patch.name, *(word for option in options for word in option)]


# --- a plug-in


def _faults_of_plugin(args: argparse.Namespace) -> list[Fault]:
    from engine.export.plugin import FORMATS, SYSTEMS

    faults, folder = list[Fault](), Path(args.plugin).expanduser()
    others = {"-o": "output", "--voices": "voices", "--target": "target", "--seconds": "seconds", "--kernel": "kernel"}
    faults += _faults_of_others(args, others, "a plug-in takes none")
    faults += _faults_of_others(args, {"--samplerate": "samplerate"}, "a plug-in has several; give --rates 44100,48000")
    if args.format is not None and args.format not in FORMATS:
        faults.append(Fault("--format", f"no format is called {args.format!r}; there are {', '.join(FORMATS)}"))
    if args.system is not None and args.system not in SYSTEMS:
        faults.append(Fault("--system", f"no system is called {args.system!r}; there are {', '.join(SYSTEMS)}"))
    if folder.is_file():
        faults.append(Fault("--plugin", f"{args.plugin}: it is a file; give a folder"))
    return faults


def _read_rates(text: str | None) -> list[int]:
    """Return the sample rates that an option lists. Raises CommandError."""
    from engine.export.plugin_data import SAMPLERATES

    try:
        return list(SAMPLERATES) if text is None else [int(word) for word in text.split(",")]
    except ValueError:
        raise CommandError(f"--rates: {text!r} is no list of sample rates; 44100,48000 is one", 2) from None


def _export_plugin(args: argparse.Namespace, scene: "Scene") -> int:
    from engine.api.plugin import export_plugin
    from engine.cli.progress import progress_feedback
    from engine.export.plugin import THIS, PluginForm
    from engine.export.plugin_library import DPF

    rates, folder = _read_rates(args.rates), Path(args.plugin).expanduser()
    formats, dpf = None if args.format is None else [args.format], Path(args.dpf or DPF).expanduser()
    form = PluginForm(formats, rates, args.slide, args.system or THIS, dpf)
    with memory_errors_explained("give fewer --rates or --slide"), progress_feedback("exporting") as progress:
        try:
            written = export_plugin(scene, folder, Path(args.patch).stem, form, progress)
        except OSError as error:
            raise CommandError(f"{args.plugin}: {error_reason(error)}") from None
    values = {"patch": args.patch, "rates": rates, "files": [str(path) for path in written]}
    print_result(args.json, values, lambda: print(f"wrote {', '.join(map(str, written))}"))
    return 0


# --- a library


def _faults_of_library(args: argparse.Namespace) -> list[Fault]:
    from engine.compiler.targets import OF_LIBRARIES

    faults, target = _faults_of_kernel(args.kernel), args.target or NATIVE
    if not Path(args.c).absolute().parent.is_dir():
        faults.append(Fault("--c", f"{args.c}: the folder that it would be in is not there"))
    if target not in OF_LIBRARIES:
        faults.append(Fault("--target", f"no target is called {target!r}; there are {', '.join(OF_LIBRARIES)}"))
    of_page = {"-o": "output", "--slide": "slide", "--voices": "voices"}
    faults += _faults_of_others(args, of_page, "it belongs to a page; a library goes to the folder of --c")
    others = {"--plugin": "plugin", **OF_PLUGIN}
    return faults + _faults_of_others(args, others, "it belongs to a plug-in; a library goes to the folder of --c")


def _export_library(args: argparse.Namespace, scene: "Scene") -> int:
    from engine.compiler.kernel_name import KernelName
    from engine.compiler.targets import target_named
    from engine.export.c_library import export_c

    target, kernel = args.target or NATIVE, KernelName(args.kernel or KERNELS[0])
    with memory_errors_explained("give fewer --seconds"):
        try:
            written = export_c(scene, Path(args.c), target, args.seconds, samplerate_of(args), kernel)
        except OSError as error:
            raise CommandError(f"{args.c}: {error_reason(error)}") from None
    if (tested_in := target_named(target).tested_in) != "use":
        known = f"its code was tested in {tested_in}" if tested_in else "its code was not tested"
        print(f"note: no {target} machine was at hand; {known}", file=sys.stderr)
    values = {"patch": args.patch, "target": target, "files": [str(path) for path in written]}
    print_result(args.json, values, lambda: print(f"wrote {args.c}: {', '.join(path.name for path in written)}"))
    return 0
