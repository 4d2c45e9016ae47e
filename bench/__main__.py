"""`uv run python -m bench [NAME …]`: run some measurements, or all."""

import importlib
import sys

NAMES = ["realtime", "instruments", "effects", "price", "jvari", "metric", "hard", "figures", "start"]


def main() -> int:
    """Run the named measurements; each module has a `run()` that prints and writes its results."""
    names = sys.argv[1:] or NAMES
    if unknown := [name for name in names if name not in NAMES]:
        print(f"bench: unknown {', '.join(unknown)}; one of {', '.join(NAMES)}", file=sys.stderr)
        return 2
    for name in names:
        importlib.import_module(f"bench.{name}").run()
    return 0


sys.exit(main())
