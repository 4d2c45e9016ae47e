"""`uv run python -m bench [NAME …]`: run some measurements, or all; `… bench compare OLD NEW`: which times have
moved; `… bench golden OLD [NEW]`: whether the samples are the same; `… bench pairs OLD [NEW]`: both timed in turn;
`… bench shipped`: make the machine code that comes with the engine; `… bench recordings FOLDER`: how far the pianos are
from recorded ones."""

import importlib
import os
import sys
import time

from bench.accuracy import golden
from bench.performance import pairs
from bench.publish import compare, shipped
from bench.recordings import command

MEASUREMENTS = {  # in this order
    "performance": [
        *("realtime", "instruments", "keyboards", "scaling", "connections", "effects", "start", "tricks", "live"),
        "endurance",
    ],
    "accuracy": ["price", "jvari", "metric", "hard", "one_way"],
    "paper": ["newton", "figures"],
    "rivals": ["peers"],
    "ruler": ["ruler", "slope", "loss"],
    "publish": ["signs", "gallery", "api"],
}
PACKAGE = {name: package for package, names in MEASUREMENTS.items() for name in names}


def main() -> int:
    """Run the named measurements; each module has a `run()` that prints and writes its results."""
    os.environ.setdefault("FDH_KERNEL", "special")  # what is measured, where no measurement says otherwise …
    os.environ["FDH_BACKGROUND"] = "off"  # … with nothing beside it
    if sys.argv[1:2] == ["compare"]:
        return compare.main(sys.argv[2:])
    if sys.argv[1:2] == ["golden"]:
        return golden.main(sys.argv[2:])
    if sys.argv[1:2] == ["pairs"]:
        return pairs.main(sys.argv[2:])
    if sys.argv[1:2] == ["shipped"]:
        return shipped.main(sys.argv[2:])
    if sys.argv[1:2] == ["recordings"]:
        return command.main(sys.argv[2:])
    if sys.argv[1:2] in (["--help"], ["-h"]):
        print(f"{__doc__}\n\n{', '.join(PACKAGE)}")
        return 0
    names = sys.argv[1:] or list(PACKAGE)
    if unknown := [name for name in names if name not in PACKAGE]:
        print(f"bench: unknown {', '.join(unknown)}; compare, or some of {', '.join(PACKAGE)}", file=sys.stderr)
        return 2
    everywhere = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    for name in names:
        begin = time.perf_counter()
        importlib.import_module(f"bench.{PACKAGE[name]}.{name}").run()
        print(f"{name}: {time.perf_counter() - begin:.0f} s", file=sys.stderr)
        if everywhere is not None:  # a measurement may have pinned itself to one core
            os.sched_setaffinity(0, everywhere)
    return 0


sys.exit(main())
