#!/usr/bin/env python3
"""Render a patch to a WAV file: `uv run render.py patches/repelled_oscillator.toml`."""

import sys

if sys.version_info < (3, 11):  # noqa: UP036  this is what an old Python gets to see
    sys.exit("render.py needs Python 3.11 or newer; with uv: uv run render.py PATCH")


def run() -> int:
    """Do what the command line says; without the packages it needs, say how they are got."""
    try:
        from engine.cli import main

        return main()
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("engine"):
            raise
        words = " ".join(sys.argv[1:]) or "PATCH"
        sys.exit(
            f"{error.name} is not installed. This sets up everything and renders:\n"
            f"  python3 -m pip install uv && uv run render.py {words}"
        )
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":  # processes that share the work import this file, and must not run it
    sys.exit(run())
