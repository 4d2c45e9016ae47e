"""The parsers of the command line, and the options that several commands share."""

import argparse
import difflib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from engine.files import find_patch
from engine.output_files import NORMALISED_PEAK_DBFS, SUBTYPES
from engine.patch.precision_key import WHY
from engine.sound.form import PRESETS
from engine.wording import to_one_line

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction["CommandParser"]

MAX_USAGE_CHARACTERS = 400  # characters of a message
VOICES = 8  # notes at a time, unless told otherwise
ACCURACY_OPTIONS = {"scheme": str, "order": int, "substeps": int, "tolerance": float, "oversample": int}
ACCURACY_OPTIONS |= {"max_error": float, "max_substeps": int}
# options that several commands have: what stands for the value, and the help
SHARED_OPTIONS = {
    "--scheme": ("NAME", "exact: linear motion is exact; fdh: the finite differences of the paper"),
    "--order": ("N", "order of accuracy: 2, 4 or 6"),
    "--substeps": ("N", "steps per sample where contact is possible"),
    "--max-error": ("E", "choose the steps of each sample by this error of the motion, such as 1e-3"),
    "--max-substeps": ("N", "steps per sample at most, where they are chosen by --max-error"),
    "--tolerance": ("T", "relative tolerance of the contact solve"),
    "--oversample": ("N", "compute everything at N times the sample rate, then decimate"),
    "--seconds": ("S", "length in seconds (default: that of the patch)"),
    "--samplerate": ("HZ", "sample rate in Hz (default: 44100)"),
    "--subtype": ("TYPE", f"sample format: {', '.join(SUBTYPES)} (default: FLOAT)"),
    "--gain": ("DB", f"gain in dB, applied to SI units (default: normalise to {NORMALISED_PEAK_DBFS:g} dBFS)"),
    "--cores": ("N", "number of processor cores to use (default: all; the samples do not depend on it)"),
    "--kernel": (
        "NAME",
        "general (default): for any scene; special: compiled for what this scene has, in half a minute",
    ),
    "--channels": ("1,2", "play these MIDI channels of a file, from 1 to 16 (default: all but 10, which are drums)"),
    "--tracks": ("0,3", "play these tracks of a MIDI file, by number from 0, or by name (default: all)"),
    "--tempo": ("BPM", "tempo of a MIDI file at its first note, in quarter notes per minute (default: its own)"),
    "--plot-style": (
        "NAME",
        "screen (default), or paper: as wide as a column of a journal, 86 mm, with letters of 8 points",
    ),
    "--voices": ("N", f"maximum number of notes at a time, with --midi (default: {VOICES})"),
    "--velocity": ("V", "MIDI velocity of --key, 1 to 127 (default: 80)"),
}
# options that became commands
MOVED = {
    "--explain": "inspect PATCH",
    "--list-devices": "devices",
    "--live": "play PATCH",
    "--price": "accuracy PATCH",
    "--replay": "replay LOG.json",
    "--vary": "sweep PATCH --vary PATH=RANGE",
}
# options that have another name today
RENAMED = {
    "--block": "--block-size",
    "--error": "--target-error",
    "--force": "--ignore-speed",
    "--log": "--event-log",
    "--sample": "--random",
}
# options that are gone, and why
REMOVED = {"--precision": f"{WHY}; leave it out"}


class Parser(argparse.ArgumentParser):
    """A parser that says in one line what is wrong, and what was meant, instead of all there is.

    Options cannot be abbreviated: `--sample` would be taken for `--samplerate`, and a new option could change what an
    old command line does.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message: str) -> NoReturn:
        """Print what is wrong, and exit with 2."""
        unknown = message.partition("unrecognized arguments: ")[2].partition(" ")[0].partition("=")[0]
        self.exit(2, f"{self.prog}: {to_one_line(message, MAX_USAGE_CHARACTERS)}; {self.suggest_option(unknown)}\n")

    def suggest_option(self, unknown: str) -> str:
        """Name the option that was meant by an unknown one, or where options are listed."""
        words = {option.lstrip("-"): option for option in self._option_string_actions}  # all dashes are alike
        near = difflib.get_close_matches(unknown.lstrip("-"), words, 1, 0.5)
        return f"did you mean {words[near[0]]}?" if near else f"{self.prog} --help lists all options"


class CommandParser(Parser):
    """The parser of one command. It knows the others, and names the one that an option belongs to."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.others: Mapping[str, CommandParser] = {}  # all commands by name; filled once they are all there
        self.instead: dict[str, str] = {}  # what to do instead of some options of other commands

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Parse the words of this command. Unknown options are refused here, where the known ones are known."""
        for word in args or ():
            if word == "--":
                break
            if answer := self.answer_old_option(word.partition("=")[0]):
                self.exit(2, f"{self.prog}: {answer}\n")
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return known, unknown

    def answer_old_option(self, option: str) -> str:
        """Return the message for an option of an earlier version, with its new name or why it is gone; "" if it is
        none."""
        if option in self._option_string_actions:
            return ""
        program = self.prog.rpartition(" ")[0]
        if option in MOVED:
            return f"{option} is now a command: {program} {MOVED[option]}"
        if option in RENAMED:
            new = RENAMED[option]
            return f"{option} is now called {new}" + ("" if new in self._option_string_actions else self.owners(new))
        if option in REMOVED:
            return f"{option} is gone: {REMOVED[option]}"
        return ""

    def owners(self, option: str) -> str:
        """Return the end of a sentence that names the commands with an option; "" if there are none."""
        programs = [other.prog for other in self.others.values() if option in other._option_string_actions]
        return f", and belongs to {', '.join(programs)}" if programs else ""

    def suggest_option(self, unknown: str) -> str:
        """Name the commands that have an option which this one has not, or the option that was meant."""
        if unknown in self.instead:
            return self.instead[unknown]
        if unknown.startswith("--") and (owners := self.owners(unknown)):
            return f"{unknown}{owners.removeprefix(', and')}"
        return super().suggest_option(unknown)


def patch_file(text: str) -> str:
    """A patch as it was given, or the file of the shipped one of that name."""
    path = find_patch(text)
    return text if path == Path(text) else str(path)


def add_command(
    commands: "Commands", name: str, run: Callable[[argparse.Namespace], int], summary: str, **settings: Any
) -> CommandParser:
    """Add a command, and return its parser.

    run:      carries the command out, and returns the exit code
    settings: of the parser, such as its description, which otherwise is the summary
    """
    description = f"{summary[0].upper()}{summary[1:]}."  # str.capitalize would write midi
    parser = commands.add_parser(name, **{"help": summary, "description": description} | settings)
    parser.set_defaults(run=run)
    return parser


def add_patch(parser: CommandParser, **settings: Any) -> None:
    """Add the patch: what every command that needs one takes."""
    help_text = "a TOML file, or the name of a shipped patch, such as tanpura"
    parser.add_argument("patch", metavar="PATCH", type=patch_file, help=help_text, **settings)


def add_options(parser: argparse._ActionsContainer, *options: str | tuple[str, str, str]) -> None:
    """Add options that take a value: names of SHARED_OPTIONS, or names with what stands for the value and the help."""
    for option in options:
        name, metavar, help_text = (option, *SHARED_OPTIONS[option]) if isinstance(option, str) else option
        parser.add_argument(name, metavar=metavar, help=help_text)


def add_plot(parser: CommandParser, contents: str) -> None:
    """Add a picture, of something."""
    help_text = f"plot {contents}, as .png, .pdf or .svg (default: a .png next to the sound file)"
    parser.add_argument("--plot", metavar="OUT.png", nargs="?", const="", help=help_text)
    add_options(parser, "--plot-style")


def add_report(parser: CommandParser, contents: str) -> None:
    """Add a page, of something."""
    help_text = f"also write an HTML page with {contents} (default: next to the sound file)"
    parser.add_argument("--report", metavar="OUT.html", nargs="?", const="", help=help_text)


def add_json(parser: CommandParser, contents: str = "the statistics") -> None:
    """Add the switch to output for programs."""
    parser.add_argument("--json", action="store_true", help=f"print {contents} as one JSON object")


def add_sound_options(parser: CommandParser) -> None:
    """Add the options that say what becomes of a sound in its file."""
    group = parser.add_argument_group("the sound in its file")
    text = "begin where the sound begins, and end where it is 70 dB below its peak, --seconds at the latest"
    group.add_argument("--trim", action="store_true", help=text)
    text = "leave the end as it is where the sound is cut, instead of fading out for 5 ms (as with --gain)"
    group.add_argument("--no-fade", action="store_true", help=text)
    loudness = "--loudness", "LUFS", "bring the sound to this loudness (ITU-R BS.1770), such as -23, with no peak above"
    add_options(group, (*loudness[:2], f"{loudness[2]} {NORMALISED_PEAK_DBFS:g} dBFS"))
    text = "make a sound that repeats without a seam: cross-fade the end with the begin for S seconds (default: 0.5)"
    group.add_argument("--loop", metavar="S", nargs="?", const="0.5", help=text)
    text = "add triangular noise before samples are rounded to 16 or 24 bits"
    group.add_argument("--dither", action="store_true", help=text)
    text = f"rate, sample format, trim and dither for a program: {', '.join(PRESETS)}"
    add_options(group, ("--for", "PROGRAM", text))


def add_accuracy_options(parser: CommandParser) -> None:
    """Add the options that take the place of [accuracy] in a patch."""
    group = parser.add_argument_group("accuracy (default: the [accuracy] table of the patch)")
    add_options(group, *("--" + name.replace("_", "-") for name in ACCURACY_OPTIONS))
