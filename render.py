#!/usr/bin/env python3
"""The command line, from a folder of sources: `uv run render.py patches/repelled_oscillator.toml`."""

import sys

WORDS = " ".join(sys.argv[1:]) or "PATCH"
FOLDER = sys.argv[0].replace("\\", "/").rpartition("/")[0]
HERE = "render.py" if FOLDER in ("", ".") else "--project " + FOLDER + " " + sys.argv[0]
SET_UP = "  python3 -m pip install uv && uv run " + HERE + " " + WORDS

if sys.version_info < (3, 11):  # noqa: UP036  this file alone is read by an old Python
    found = ".".join(map(str, sys.version_info[:2]))
    sys.exit("render.py needs Python 3.11 or newer, and this is " + found + ". This brings one and renders:\n" + SET_UP)


def run():
    """Do what the command line says; without the packages it needs, say how they are got."""
    try:
        from engine.cli.main import program

        return program()
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("engine"):
            raise
        sys.exit(error.name + " is not installed. This sets up everything and renders:\n" + SET_UP)
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":  # processes that share the work import this file, and must not run it
    sys.exit(run())
