"""`uv run python -m bench`: list the names; `… bench NAME …`: run some measurements, and `… bench all`: all whose
tables are of older kernels, so that a run that was stopped goes on (`… bench all --anew`: all of them); `… bench
compare OLD NEW`: which times have moved; `… bench golden OLD [NEW]`: whether the samples are the same; `… bench
machines`: whether tables depend on the machine; `… bench pairs OLD [NEW]`: both timed in turn; `… bench builds OLD`:
how long tables take to build; `… bench events`: the price of an event; `… bench levels`: kernels for each level of this
processor; `… bench inputs`: the delay of a note behind a controller; `… bench notes FOLDER`: whether each note of MIDI
files sounds as it does alone; `… bench shipped`: make the machine code that comes with the engine; `… bench stale`:
which tables are of older kernels; `… bench site [FOLDER]`: the guides as a site; `… bench playable [FOLDER]`: a site on
which every patch plays; `… bench ruler_package FOLDER`: the problems of the ruler as a package of their own; `… bench
recordings FOLDER`: how far pianos and toms are from recorded ones; `… bench exhibit PATCH …`: the parts of the gallery
that show some patches; `… bench pieces [PATCH …]`: its pieces of music."""

import ast
import difflib
import importlib
import inspect
import os
import re
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

from bench.accuracy import golden, machines, notes
from bench.performance import builds, events, inputs, levels, pairs, special
from bench.publish import compare, exhibit, performances, playable, ruler_package, shipped, site, stale
from bench.recordings import command

SENTENCE_END = re.compile(r"[.?] (?=[A-Z])")
LINE_LENGTH = 100
MEASUREMENTS = {  # in this order
    "performance": [
        *(
            "realtime",
            "instruments",
            "keyboards",
            "scaling",
            "connections",
            "stretching",
            "effects",
            "start",
            "tricks",
            "live",
            "rigs",
        ),
        "endurance",
    ],
    "accuracy": [
        *("price", "jvari", "metric", "hard", "one_way", "bowing", "bowed_pitch", "estimates", "features"),
        *("pitch", "steps"),
    ],
    "paper": ["newton", "figures", "equations"],
    "rivals": ["peers"],
    "ruler": ["ruler", "slope", "loss", "chosen"],
    "publish": ["signs", "gallery", "api", "cli"],
}
PACKAGE = {name: package for package, names in MEASUREMENTS.items() for name in names}
OTHERS: dict[str, Callable[[list[str]], int]] = {  # that are no tables, and have arguments
    "builds": builds.main,
    "compare": compare.main,
    "golden": golden.main,
    "machines": machines.main,
    "notes": notes.main,
    "pairs": pairs.main,
    "events": events.main,
    "levels": levels.main,
    "special": special.main,
    "inputs": inputs.main,
    "shipped": shipped.main,
    "stale": stale.main,
    "site": site.main,
    "playable": playable.main,
    "ruler_package": ruler_package.main,
    "recordings": command.main,
    "exhibit": exhibit.main,
    "pieces": performances.main,
}


def describe(name: str) -> str:
    """A name with the first sentence of its module's docstring, on one line. Measurements are not imported for it."""
    module = OTHERS[name].__module__.removeprefix("bench.") if name in OTHERS else f"{PACKAGE[name]}.{name}"
    source = Path(__file__).parent.joinpath(*module.split(".")).with_suffix(".py").read_text("utf-8")
    text = " ".join((ast.get_docstring(ast.parse(source)) or "").split())
    sentence = SENTENCE_END.split(text, maxsplit=1)[0].rstrip(".?")
    return f"{name:<14}{textwrap.shorten(sentence, LINE_LENGTH - 14, placeholder=' …')}"


def explain(name: str) -> int:
    """Print what one that has arguments says of itself; returns the exit code."""
    command = OTHERS[name]
    print(f"{inspect.getdoc(sys.modules[command.__module__])}\n\n{inspect.getdoc(command)}")
    return 0


def main() -> int:
    """Run the named measurements; each module has a `run()` that prints and writes its results."""
    if sys.argv[1:2] and sys.argv[1] in OTHERS:
        if {"--help", "-h"} & {*sys.argv[2:]}:
            return explain(sys.argv[1])
        return OTHERS[sys.argv[1]](sys.argv[2:])
    if sys.argv[1:2] in ([], ["--help"], ["-h"]):
        print(f"{__doc__}\n")
        for name in (*PACKAGE, *OTHERS):
            print(describe(name))
        return 0
    names = sys.argv[1:]
    if names in (["all"], ["all", "--anew"]):
        names = [name for name in PACKAGE if names[1:] or not stale.is_finished(name)]
    if unknown := [name for name in names if name not in PACKAGE]:
        near = difflib.get_close_matches(unknown[0], [*PACKAGE, *OTHERS], 1)
        remedy = f"did you mean {near[0]}?" if near else "python -m bench lists the names"
        print(f"bench: unknown {', '.join(unknown)}; {remedy}", file=sys.stderr)
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
