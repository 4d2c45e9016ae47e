"""Arguments of the command line, and all that is wrong with them, said at once."""

import argparse
import difflib
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

from engine import formats
from engine.files import is_folder
from engine.save import LOUDNESS, SUBTYPES, absolute, subtype_of, writable
from engine.wording import one_line

LONGEST = 400  # characters of a message
EXAMPLE = "patches/repelled_oscillator.toml"
COMMANDS = """commands (render.py COMMAND --help tells more):
  new NAME      start a patch from a template
  check PATCH…  only validate patches
  params PATCH  list the numbers of a patch, with units and ranges
  reference     every key of a patch, as in docs/patches.md
  schema        the JSON Schema of a patch, for editors
  recover FOLDER  keep recordings that were broken off
  cache         where compiled kernels are kept, how large they are; --clear deletes them
"""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, with the option that was meant, and not all there is."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong, and exit with 2."""
        unknown = message.partition("unrecognized arguments: ")[2].partition(" ")[0].partition("=")[0]
        near = difflib.get_close_matches(unknown, self._option_string_actions, 1, 0.6)
        right = f"did you mean {near[0]}?" if near else f"{self.prog} --help tells all"
        self.exit(2, f"{self.prog}: {one_line(message, LONGEST)}; {right}\n")


def parser() -> argparse.ArgumentParser:
    """Arguments of a render. Numbers come as text, so that all that is wrong is said at once."""
    parse = Parser(
        prog="render.py",
        description="Render a patch to a WAV file. Energy-exact collisions; see README.md.",
        epilog=f"{COMMANDS}\nexample: render.py {EXAMPLE} -o out.wav",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parse.add_argument("patch", metavar="PATCH", nargs="?", help="a TOML file, such as those in patches/")
    parse.add_argument("-o", "--output", metavar="OUT.wav", help="the file to write (default: the patch's name, here)")
    parse.add_argument("--seconds", metavar="S", help="length, s (default: what the patch says)")
    parse.add_argument("--samplerate", metavar="HZ", help="sample rate, Hz (default: 44100; live, the device's own)")
    parse.add_argument("--subtype", metavar="TYPE", help=f"sample format: {', '.join(SUBTYPES)} (default: FLOAT)")
    parse.add_argument("--gain", metavar="DB", help=f"fixed gain, dB, on SI units (default: peak at {LOUDNESS:g} dBFS)")
    dial = parse.add_argument_group("accuracy (default: what the patch says under [accuracy])")
    dial.add_argument("--scheme", metavar="NAME", help="exact: free vibration in tune; fdh: the paper's")
    dial.add_argument("--order", metavar="N", help="of a step: 2, 4 or 6")
    dial.add_argument("--substeps", metavar="N", help="steps per sample where contact is possible")
    dial.add_argument("--tolerance", metavar="T", help="relative error left in a compression")
    dial.add_argument("--oversample", metavar="N", help="compute all at a multiple of the sample rate")
    dial.add_argument("--precision", metavar="TYPE", help="of the modes: float64 or float32")
    parse.add_argument(
        "--cores", metavar="N", help="how many may share the work (default: all; the samples are the same)"
    )
    parse.add_argument(
        "--explain", action="store_true", help="what is built and left out, and what each island costs; writes no file"
    )
    parse.add_argument(
        "--price",
        action="store_true",
        help="errors and costs at a ladder of settings; writes no sound without --report",
    )
    parse.add_argument(
        "--plot",
        metavar="OUT.png",
        nargs="?",
        const="",
        help="draw waveform, spectrogram, energies and contacts (default: beside the sound); with --price, error"
        " against time",
    )
    parse.add_argument(
        "--report",
        metavar="OUT.html",
        nargs="?",
        const="",
        help="also write a page to listen to and look at, all in one file (default: beside the sound); with --price,"
        " that is rendered too, and in it",
    )
    parse.add_argument(
        "--error", metavar="E", help="render at the cheapest setting that errs less: 1e-4, or 0.1dB of a band"
    )
    parse.add_argument("--trace", metavar="OUT.npz", help="also write every sample's displacements, forces, energies")
    vary = parse.add_argument_group("variations")
    vary.add_argument(
        "--vary",
        metavar="PATH=RANGE",
        action="append",
        help="render all of contact.felt.stiffness=1e8..1e10:log:16 into the folder -o, with an index.csv; or"
        " PATH=A..B:N, PATH=A,B,C; several make a grid",
    )
    vary.add_argument("--sample", metavar="N", help="as many points at random instead of the grid")
    vary.add_argument("--seed", metavar="S", help="of these points (default: 0)")
    vary.add_argument("--cluster", metavar="ADDRESS", help="let the workers of a Dask scheduler render")
    live = parse.add_argument_group("live sound")
    live.add_argument("--live", action="store_true", help="play instead; Ctrl-C or q ends it")
    live.add_argument("--list-devices", action="store_true", help="what can be played on")
    live.add_argument("--device", metavar="NAME", help="a device's number, or part of its name (default: the system's)")
    live.add_argument("--block", metavar="N", default=USUAL["block"], help="frames of a block (default: %(default)s)")
    live.add_argument("--latency", metavar="L", help="low, high, or seconds (default: the device's)")
    live.add_argument("--record", metavar="OUT.wav", help="also write what is played")
    live.add_argument("--log", metavar="LOG.json", help="also write what was done")
    live.add_argument("--replay", metavar="LOG.json", help="render what was played, bit for bit, to -o OUT.wav")
    live.add_argument("--midi", metavar="FILE.mid", help="play its notes, live or to a file; or those of a port, live")
    live.add_argument("--voices", metavar="N", default=USUAL["voices"], help="notes at a time (default: %(default)s)")
    live.add_argument("--watch", action="store_true", help="take over what is saved to the patch while it plays")
    live.add_argument("--force", action="store_true", help="play even what is too heavy for real time")
    live.add_argument(
        "--callback", metavar="KIND", default=USUAL["callback"], help="compiled (default), or python to compare"
    )
    parse.add_argument("--json", action="store_true", help="print the statistics as one JSON object")
    return parse


def settings(args: argparse.Namespace) -> tuple[dict[str, float | None], list[tuple[str, str]]]:
    """The numbers among the arguments, and what is wrong with the arguments."""
    from engine.parts import SECONDS
    from engine.scene import SAMPLERATES

    ranges = {"seconds": (0.0, SECONDS, "s"), "samplerate": (*SAMPLERATES, "Hz"), "gain": (-400.0, 400.0, "dB")}
    ranges["cores"] = (1, 1024, "cores")
    numbers: dict[str, float | None] = {}
    wrong: list[tuple[str, str]] = []
    for name, (low, high, unit) in ranges.items():
        text = getattr(args, name)
        right = f"{'more than 0' if name == 'seconds' else f'{low:g}'} to {high:g} {unit}"
        try:
            number = None if text is None else float(text)
        except ValueError:
            wrong.append((f"--{name}", f'"{text}" is not a number; {right}'))
            continue
        if number is not None and (not low <= number <= high or (name == "seconds" and number == 0)):
            wrong.append((f"--{name}", f"{text} is out of range; {right}"))
        elif name in ("samplerate", "cores") and number is not None and number != int(number):
            wrong.append((f"--{name}", f"{text} is not a whole number; {right}"))
        numbers[name] = number
    if args.error is not None:
        try:
            error_of(args.error)
        except ValueError:
            wrong.append(("--error", f'"{args.error}" is no error; a share as 1e-4, or decibels as 0.1dB'))
    if not args.voices.isdecimal() or not 1 <= int(args.voices) <= 64:
        wrong.append(("--voices", f'"{args.voices}" is no number of voices; 1 to 64'))
    for option in ("--plot", "--report"):
        if getattr(args, option[2:]) is not None and find_spec("matplotlib") is None:
            wrong.append((option, "needs matplotlib; uv sync --extra plot, or pip install matplotlib"))
    if args.plot is not None and args.explain:
        wrong.append(("--plot", "draws a render, or with --price what accuracy costs; --explain renders nothing"))
    if args.report is not None and args.explain:
        wrong.append(("--report", "is of a render, and holds what --explain tells; leave that out"))
    return numbers, wrong + undialled(args)


def dial_of(args: argparse.Namespace) -> dict[str, Any]:
    """The accuracy asked for, as numbers where it can be."""
    kinds = {"scheme": str, "order": int, "substeps": int, "tolerance": float, "oversample": int, "precision": str}
    asked: dict[str, Any] = {}
    for name, kind in kinds.items():
        text = getattr(args, name)
        try:
            asked[name] = None if text is None else kind(text)
        except ValueError:
            asked[name] = text
    return asked


def undialled(args: argparse.Namespace) -> list[tuple[str, str]]:
    """What is wrong with the accuracy asked for."""
    from engine.accuracy import Accuracy
    from engine.patch import wrong_value

    asked = {name: value for name, value in dial_of(args).items() if value is not None}
    found = ((name, wrong_value(Accuracy, name, value)) for name, value in asked.items())
    return [(f"--{name}", what) for name, what in found if what]


def output_of(args: argparse.Namespace) -> Path:
    """The file to write."""
    if args.output:
        return Path(args.output)
    return Path(f"{Path(args.replay).stem}_replay.wav" if args.replay else f"{Path(args.patch or 'out').stem}.wav")


def plot_of(args: argparse.Namespace) -> Path | None:
    """The picture to write, if one is asked for."""
    return None if args.plot is None else Path(args.plot) if args.plot else output_of(args).with_suffix(".png")


def report_of(args: argparse.Namespace) -> Path | None:
    """The page to write, if one is asked for."""
    return None if args.report is None else Path(args.report) if args.report else output_of(args).with_suffix(".html")


USUAL = {"block": "256", "voices": "8", "callback": "compiled"}
LIVE_ONLY = ("device", "block", "latency", "record", "log", "watch", "force", "callback")
NOT_LIVE = ("output", "trace", "explain", "price", "plot", "report", "error", "cores")
VARIED_ONLY = ("sample", "seed", "cluster")
NOT_VARIED = ("live", "midi", "voices", "explain", "price", "plot", "trace", "error", "report", *LIVE_ONLY)
NOT_REPLAYED = ("patch", "live", "seconds", "samplerate", "gain", "midi", "voices", "vary", *LIVE_ONLY, *NOT_LIVE[1:])


def misplaced(args: argparse.Namespace) -> list[tuple[str, str]]:
    """Arguments that what is asked for takes no notice of."""
    given = [name for name, value in vars(args).items() if value not in (None, False, USUAL.get(name))]
    if args.replay:
        wrong = dict.fromkeys(NOT_REPLAYED + VARIED_ONLY, "the log says it all; give -o OUT.wav")
    elif args.vary:
        wrong = dict.fromkeys(NOT_VARIED, "not for --vary; it renders sounds, and features of them to index.csv")
    elif args.live:
        wrong = dict.fromkeys(NOT_LIVE, "not for --live; --record OUT.wav keeps what is played")
    else:
        wrong = dict.fromkeys(LIVE_ONLY, "for --live; give that too")
        not_notes = ("explain", "price", "trace", "plot", "report", "error")
        wrong |= dict.fromkeys(not_notes, "not for --midi") if args.midi else {}
    if args.explain and not args.replay:
        wrong |= dict.fromkeys(("output", "trace", "price", "error"), "not for --explain, which renders nothing")
    elif args.price and args.report is None and not args.replay:
        wrong |= dict.fromkeys(("output", "trace", "error"), "not for --price, which writes no sound")
    if not args.midi and not args.vary and not args.replay:
        wrong["voices"] = "for --midi; give that too"
    if not args.vary and not args.replay:
        wrong |= dict.fromkeys(VARIED_ONLY, "for --vary; give that too")
    return [(f"--{name}" if name != "patch" else "PATCH", wrong[name]) for name in given if name in wrong]


KINDS = {"--report": ("page", (".html", ".htm")), "--plot": ("picture", (".png",)), "--trace": ("trace", (".npz",))}
KINDS["--log"] = ("log", (".json",))


def sound_of(args: argparse.Namespace) -> tuple[str, Path | None]:
    """The sound to be written, if one is, and the option that names it."""
    if args.live:
        return "--record", Path(args.record) if args.record else None
    return "--output", output_of(args) if args.report is not None or not (args.explain or args.price) else None


def unheld(args: argparse.Namespace, samplerate: int, channels: int) -> list[tuple[str, str]]:
    """What of the sound the file to be written cannot hold."""
    option, output = sound_of(args)
    what = formats.unheld(output, samplerate, channels) if output is not None else ""
    return [(option, what)] if what else []


def unwritable(args: argparse.Namespace) -> list[tuple[str, str]]:
    """What is wrong with the files to be written."""
    option, sound = sound_of(args)
    if args.live:
        targets = {"--record": sound, "--log": args.log}
    else:
        targets = {"--output": sound, "--trace": args.trace, "--plot": plot_of(args), "--report": report_of(args)}
    wrong = []
    paths = {option: Path(text) for option, text in targets.items() if text}
    for name, path in paths.items():
        what, endings = KINDS.get(name, ("", ()))
        if endings and path.suffix.lower() not in endings:
            wrong.append((name, f'"{path.name}" names no {what}; end it in {endings[0]}'))
        elif not is_folder(path.parent):
            wrong.append((name, f"no such folder: {path.parent}; make it, or write elsewhere"))
        elif is_folder(path):
            wrong.append((name, f"{path} is a folder; give the name of a file, such as {path / 'sound.wav'}"))
        elif not writable(path.parent):
            where = "the folder you are in" if path.parent == Path() else path.parent
            wrong.append((name, f"{where} cannot be written to; write elsewhere: {name} FOLDER/{path.name}"))
        if sum(absolute(path) == absolute(other) for other in paths.values()) > 1:
            wrong.append((name, f"{path} is to be written twice; give two names"))
    return wrong + unheard(sound or (Path("none.wav") if args.live else output_of(args)), args.subtype, option)


def unheard(output: Path, subtype: str | None, option: str) -> list[tuple[str, str]]:
    """What is wrong with the format of an audio file."""
    import soundfile

    kind = output.suffix.lstrip(".").upper()
    if kind not in soundfile.available_formats():
        return [(option, f'"{output.name}" names no audio format; end it in .wav')]
    if subtype is not None and subtype not in SUBTYPES:
        return [("--subtype", f'unknown sample format "{subtype}"; {", ".join(SUBTYPES)}')]
    if not soundfile.check_format(kind, subtype_of(output, subtype)):
        if subtype is None:
            return [("--subtype", f"{kind} files do not say what they hold; give --subtype FLOAT, or write a .wav")]
        return [("--subtype", f"{kind} files cannot hold {subtype}; write a .wav")]
    return []


def error_of(text: str) -> tuple[float, bool]:
    """An error asked for: 1e-4, or 0.1dB. Raises ValueError."""
    decibels = text.lower().endswith("db")
    amount = float(text[:-2] if decibels else text)
    if not 0.0 < amount < 100.0:
        raise ValueError(text)
    return amount, decibels
