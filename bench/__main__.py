"""`uv run python -m bench [NAME …]`: run some measurements, or all."""

import importlib
import os
import sys

NAMES = ["realtime", "instruments", "effects", "price", "jvari", "metric", "hard", "figures", "start"]


def main() -> int:
    """Run the named measurements; each module has a `run()` that prints and writes its results."""
    names = sys.argv[1:] or NAMES
    if unknown := [name for name in names if name not in NAMES]:
        print(f"bench: unknown {', '.join(unknown)}; one of {', '.join(NAMES)}", file=sys.stderr)
        return 2
    everywhere = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    for name in names:
        importlib.import_module(f"bench.{name}").run()
        if everywhere is not None:  # a measurement may have pinned itself to one core
            os.sched_setaffinity(0, everywhere)
    return 0


sys.exit(main())
