"""The command line: which command is meant, and its exit code. Commands import the engine when they run, so that
--help and errors answer at once."""

import argparse
import difflib
import os
import re
import sys
from pathlib import Path
from typing import Any

from engine.cli import standard_streams
from engine.cli.accuracy_command import add_accuracy_command
from engine.cli.arguments import CommandParser, Parser
from engine.cli.doctor_command import add_doctor_command
from engine.cli.export_command import add_export_command
from engine.cli.inspect_command import add_inspect_command
from engine.cli.level_command import add_level_command
from engine.cli.machine_commands import add_machine_commands
from engine.cli.messages import (
    CommandError,
    InputError,
    patch_warnings_as_notes,
    print_error,
    print_faults,
)
from engine.cli.patch_commands import add_patch_commands
from engine.cli.play_command import add_play_command
from engine.cli.render_command import add_render_command
from engine.cli.replay_command import add_replay_command
from engine.cli.sweep_command import add_sweep_command
from engine.faults import BuildError, PatchError
from engine.files import find_patch, is_folder, path_exists, shipped_names
from engine.wording import join_with_or, program_name

COMMAND_GROUPS = (
    add_render_command,
    add_play_command,
    add_sweep_command,
    add_replay_command,
    add_accuracy_command,
    add_export_command,
    add_inspect_command,
    add_level_command,
    add_patch_commands,
    add_machine_commands,
    add_doctor_command,
)
DEFAULT = "render"  # what is done to a patch, where no command is given
FORMER_COMMANDS = {  # and where they went
    "score": "the problems and their scorer are a package of their own, contact_ruler: see docs/ruler.md"
}
OF_THE_PROGRAM = ("-h", "--help", "--version")
COMMAND_WORD = re.compile(r"[\w-]{1,40}")  # what may be a misspelt command or shipped patch: no path
EXAMPLE = "tanpura"
EPILOG = """{program} PATCH … is short for {program} render PATCH …
{program} COMMAND --help lists the options of a command.
PATCH is a file, or the name of a shipped patch:
{shipped}

example: {program} {example} -o out.wav"""


def program() -> int:
    """Run the command line as a program of its own, whatever its standard streams are; returns the exit code."""
    standard_streams.prepare()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small; to start threads takes 0.1 s
    try:
        code = main()
    except SystemExit as end:  # of argparse
        code = end.code if isinstance(end.code, int) else 0
    return standard_streams.finish(code)


def main(words: list[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0, 1 (failed), 2 (bad input), 130 (Ctrl-C)."""
    words = sys.argv[1:] if words is None else words
    try:
        parser, commands = build_parser()
        if not words:
            remedy = f"such as {EXAMPLE}, or start one with {program_name()} new NAME"
            parser.error(f"give a PATCH, {remedy}")
        if words[0] not in commands and words[0] not in OF_THE_PROGRAM:
            if meant := suggest_command(words[0], list(commands)):
                print_error(f'no command, file or shipped patch is called "{words[0]}"; {meant}')
                return 2
            words = [DEFAULT, *words]
        args = parser.parse_args(words)
        with patch_warnings_as_notes():
            code: int = args.run(args)
        return code
    except CommandError as failure:
        print_error(failure)
        return failure.code
    except InputError as error:
        print_faults(error.faults)
        return 2
    except (BuildError, PatchError) as error:
        from engine.patch.reader import locate_faults

        print_faults(locate_faults(args.patch, error.faults))
        return 2
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        return 130


def build_parser() -> tuple[Parser, dict[str, CommandParser]]:
    """The parser of the whole command line, and those of its commands."""
    name = program_name()
    parser = Parser(
        prog=name,
        description="Synthesise the sound of colliding bodies: render patches to sound files, or play them live.",
        epilog=EPILOG.format(program=name, shipped=list_shipped(), example=EXAMPLE),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=ShowVersion, nargs=0, help="show the version of the engine")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", parser_class=CommandParser, required=True)
    for add in COMMAND_GROUPS:
        add(commands)
    parsers: dict[str, CommandParser] = dict(commands.choices)
    for command in parsers.values():
        command.others = parsers
    return parser, parsers


class ShowVersion(argparse.Action):
    """Print the version and exit; it is looked up only when it is needed."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print the version of the engine."""
        import engine

        print(f"fdh {engine.__version__}")
        parser.exit()


def list_shipped() -> str:
    """The names of the shipped patches, on lines of the help."""
    lines = [""]
    for name in shipped_names():
        if len(lines[-1]) + len(name) > 76:
            lines.append("")
        lines[-1] += f"  {name}"
    return "\n".join(lines)


def suggest_command(word: str, commands: list[str]) -> str:
    """Suggest the command that was meant by a first word, or say where a former one went. Return "" if the word is a
    command, a file, a shipped patch, or a path, which the reader of patches explains better."""
    if word.startswith("-") or not COMMAND_WORD.fullmatch(word) or path_exists(find_patch(word)):
        return ""
    if word in FORMER_COMMANDS:
        return FORMER_COMMANDS[word]
    files = sorted(Path().glob("*.toml")) if is_folder(Path()) else []
    meant = {name: name for name in shipped_names()} | {path.stem: str(path) for path in files}
    meant |= {command: command for command in commands}
    near = list(dict.fromkeys(f'"{meant[name]}"' for name in difflib.get_close_matches(word, meant, 3, 0.6)))
    if near:
        return f"did you mean {join_with_or(near)}?"
    return f"{program_name()} --help lists commands and shipped patches"
