"""The command line, as `python -m fdh`."""

import sys

from engine.cli.main import program

if __name__ == "__main__":  # processes that share the work import this file, and must not run it
    sys.exit(program())
