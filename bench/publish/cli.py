"""docs/cli.md: every command with its options, from the parsers of the command line."""

import argparse
import textwrap

from bench.publish.report import ROOT, read_table
from engine.cli.arguments import ACCURACY_OPTIONS, CommandParser
from engine.cli.main import DEFAULT, build_parser
from engine.files import shipped_names

LINE_LENGTH = 118
BAR = "\\|"  # in a cell of a table
TABLE_HEAD = "| argument | meaning |", "| --- | --- |"
PAGE = ROOT / "docs" / "cli.md"
INTRODUCTION = """# The command line

`uv run python -m bench cli` writes this page from the parsers, and a test compares them. `fdh COMMAND --help` shows
the same text.

The program is called `fdh`. In a checkout, `uv run fdh` runs it; `uv run render.py` and `python -m fdh` are the same
program. `fdh PATCH …` is short for `fdh render PATCH …`.

PATCH is a file, or the name of a shipped patch, which works in any folder:
"""
NOTES = {  # on what the options cannot say, under the table of a command
    "render": """
- Signals are in SI units and can be very small. The file is therefore normalised to −1 dBFS, and the gain is printed;
  `--gain 0` keeps SI units, and `--level patch` gives the file the [level](live.md#level) of live sound.
- A rendering estimates the error of its first twentieth where that costs little. `--error-estimate` compares all
  of it, and `--target-error 1e-3` renders until the error is smaller: [what accuracy costs](accuracy.md).
- `--trace` writes every sample's displacement, velocity, compression, force, Newton iterations and energies, with the
  names, positions and units of the columns. A contact at several points has one column for each, in the order of the
  patch.
- `--plot` plots the waveform of each channel, the spectrogram, energies and Newton iterations, with contact shaded; the
  force and compression of the first contact; and the shape of the string that moves first, over two periods. The
  colours can also be distinguished in greyscale print.
- `--report` writes one HTML page with all plots, an audio player, the statistics, the enabled and disabled effects, and
  the patch.
- `--midi` plays a MIDI file, or standard input if it is `-`, and `--play` gives some of its parts to other patches:
  [instruments](instruments.md).
- A file is written beside its name and then renamed, so that none is ever half-written. Links are followed, a file
  keeps its mode, and one that is read-only is refused before anything is rendered; a named pipe or a device is sent the
  whole file. Equal sounds are equal files, byte for byte. A WAV of more than 4 GiB becomes RF64.""",
    "play": """
The space bar strikes, 1 to 9 strike softer or harder, `m` mutes, `q` ends. When a block comes close to its deadline,
the engine reduces quality before the sound drops out; the energy stays exact at each quality.
[Playing live](live.md) has MIDI, Open Sound Control, controls and logs; [installation](installation.md) has the audio
library.""",
    "sweep": """
```sh
uv run fdh sweep piano_c4 --vary contact.felt.stiffness=1e7..1e10:log:16 --vary body.hammer.velocity=1,2,4 -o felts/
uv run fdh sweep piano_c4 --vary contact.felt.stiffness=1e7..1e10:log --random 100 --seed 1 -o any_felts/
uv run fdh sweep piano --notes A0..C8/3 --velocities 8 --sfz -o set/
```

A sweep writes one WAV file for each point, named by its values, all at one gain and using all cores, and `index.csv`
with the values, pitch, decay, brightness, level, iterations and energy error of each; `trusted`, 1 or 0, and the
`reasons` why not; `unconverged`, how many contact solves did not converge, and how many of them were `capped` by the
iteration limit. If it is interrupted, the same
command continues it. A point that fails is recorded, and the others continue. `fdh params PATCH` lists the paths that
can be varied. `--cluster ADDRESS` sends the points to a Dask scheduler (`uv sync --extra cluster`); workers with
another version of the engine are listed and not used. `--notes` renders notes, and `--sfz` writes a key map for
samplers:
[a multisample set](instruments.md#a-multisample-set). From Python, `fdh.run_sweep` renders a sweep, and
`fdh.read_sweep` reads one ([the Python interface](api.md)).

### Features of a sound

[The Python interface](api.md#fdhanalysisfeaturesfeatures) says how each is computed. `centroid_hz` hears the attack,
`strongest_hz` is the partial with the most energy, and `fundamental_hz` does not mind repeated strikes. `t60_s` is the
slope between -5 and -25 dB, after the last strike if there are several; where it would be wrong, it is empty, and
`t60_reason` says why. Two hundred synthetic sounds, whose features are known, have the errors of the table. The
centroid is up to 3 % off below 35 Hz, and for a mode that begins at neither its zero nor its peak and falls by 60 dB
within 200 periods.

{features}""",
    "accuracy": """
The reference is refined until it converges. [What accuracy costs](accuracy.md) explains the table and the verdict.""",
    "inspect": """
The table has the modes, contacts, solver and cost of each island. The worst case is the cost of its slowest block of
256 samples, of two runs the faster; at 44.1 kHz, 22 676 ns per sample are real time. The list after it says which
effects are enabled or disabled in this scene, and why. For each [body that
stretches](bodies.md#bodies-that-stretch) it says when its tension rose and when it was linear, and how far its tension
rose at most. Each force of a bow on a string stands beside the limits within which that string can be played ([the
force of a bow](friction.md#the-force-of-a-bow)).""",
}
CONVENTIONS = """
## Output, errors and exit codes

- **Results** are printed on standard output, one fact per line. `--json` prints one JSON object instead, and
  `--verbose` prints all statistics as text. They include the histogram of Newton iterations, and how many samples each
  solver branch took: free, separating, closed form, Newton, iteration limit reached (the coupled solve stopped at its
  limit, and the forces were scaled so that they create no energy), or failed.
- **Notes, progress and errors** are printed on standard error. Long operations show a bar, or, without a terminal, a
  line every ten seconds.
- **Errors in a patch** have the form `file:line path: what is wrong; what to do`. All errors are listed at once, at
  most 50 of them. Unknown keys and options are errors, and the message suggests the closest known one.
- **`NOT TO BE TRUSTED`** (`"trusted": false` and `reasons` in the JSON output) means that the motion or the energy of a
  rendering may be wrong; the reason follows. The file is written, and the exit code is 0: a script has to read
  `trusted`.
- **Files** appear only when they are complete. An interrupted command leaves no partial file.

| exit code | meaning |
| --- | --- |
| 0 | done |
| 1 | a file could not be written, or standard output was closed or full (the files are complete then) |
| 2 | bad input: an error in a patch, an option or a file |
| 130 | interrupted by Ctrl-C; `fdh render` writes what was rendered by then, also of voices and mixes |
| 128 + signal | `fdh play` was ended by another signal; the sound has faded out, and its files are written |

## Environment variables

| variable | effect |
| --- | --- |
| `FDH_CACHE_LIMIT` | largest size of the kernel cache, in megabytes (default: 500) |
| `NUMBA_CACHE_DIR` | folder of the kernel cache, instead of that of the user |

[Start-up, kernels and cache](start_up.md) explains them.
"""


def run() -> None:
    """Write the page."""
    PAGE.write_text(compose_page(), "utf-8")


def compose_page() -> str:
    """Return the page as Markdown."""
    names = textwrap.fill(", ".join(f"`{name}`" for name in shipped_names()), LINE_LENGTH, break_on_hyphens=False)
    _, commands = build_parser()
    sections = [*map(describe_command, commands.values()), describe_accuracy_options(commands[DEFAULT])]
    return "\n".join([INTRODUCTION, f"{names}.", *sections, CONVENTIONS.rstrip(), ""])


def describe_command(parser: CommandParser) -> str:
    """Return the section of one command: its summary, its usage and its options."""
    lines = ["", f"## {parser.prog}", "", *textwrap.wrap(parser.description or "", LINE_LENGTH), ""]
    lines += ["```text", *compose_usage(parser), "```"]
    listed = [action for action in arguments_of(parser) if not is_accuracy_option(action)]
    if listed:
        lines += ["", *TABLE_HEAD, *map(describe_argument, listed)]
    if len(listed) < len(arguments_of(parser)):
        lines += ["", "It also takes the [accuracy options](#accuracy-options)."]
    if notes := NOTES.get(parser.prog.rpartition(" ")[2]):
        lines += [notes.replace("{features}", read_table("features")) if "{features}" in notes else notes]
    if parser.epilog:
        lines += ["", "```text", parser.epilog.rstrip(), "```"]
    return "\n".join(lines)


def describe_accuracy_options(parser: CommandParser) -> str:
    """Return the section of the options that several commands share."""
    rows = map(describe_argument, filter(is_accuracy_option, arguments_of(parser)))
    text = (
        "They replace values of the `[accuracy]` table of the patch. [What accuracy costs](accuracy.md) compares them."
    )
    return "\n".join(["", "## Accuracy options", "", text, "", *TABLE_HEAD, *rows])


def compose_usage(parser: CommandParser) -> list[str]:
    """Return the synopsis of a command in lines, with its positional arguments first."""
    listed = [action for action in arguments_of(parser) if not is_accuracy_option(action)]
    words = [usage_of(action) for action in sorted(listed, key=lambda action: bool(action.option_strings))]
    words += ["[accuracy options]"] * (len(listed) < len(arguments_of(parser)))
    text = " ".join([parser.prog, *(word.replace(" ", "\0") for word in words)])  # an option stays beside its value
    wrapped = textwrap.wrap(text, LINE_LENGTH, subsequent_indent=" " * (len(parser.prog) + 1), break_on_hyphens=False)
    return [line.replace("\0", " ") for line in wrapped]


def describe_argument(action: argparse.Action) -> str:
    """Return the row of an argument in the table of its command."""
    names = [f"`{name}`" for name in action.option_strings or [str(action.metavar)]]
    if action.option_strings and (value := value_of(action)):
        names[-1] += f" `{value}`"
    row = ", ".join(names), (action.help or "") % vars(action)
    return f"| {' | '.join(cell.replace('|', BAR) for cell in row)} |"


def arguments_of(parser: CommandParser) -> list[argparse.Action]:
    """Return the arguments of a command that are shown to users, except --help, which every command has."""
    return [a for a in parser._actions if a.help != argparse.SUPPRESS and not isinstance(a, argparse._HelpAction)]


def is_accuracy_option(action: argparse.Action) -> bool:
    """True if an option replaces a value of the [accuracy] table of a patch."""
    return action.dest in ACCURACY_OPTIONS


def usage_of(action: argparse.Action) -> str:
    """Return an argument as a synopsis shows it: with its value, and in brackets if it may be left out."""
    if not action.option_strings:
        return {"+": f"{action.metavar} [{action.metavar} …]", "?": f"[{action.metavar}]"}.get(
            str(action.nargs), str(action.metavar)
        )
    text = " ".join(filter(None, [action.option_strings[0], value_of(action)]))
    return text if action.required else f"[{text}]"


def value_of(action: argparse.Action) -> str:
    """Return how the value of an option is written; nothing for a switch."""
    if action.nargs == 0 or action.metavar is None:
        return ""
    return f"[{action.metavar}]" if action.nargs == "?" else str(action.metavar)
