"""Where measurements go: a CSV in bench/results, and a table in README.md or docs."""

import csv
import datetime
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import llvmlite.binding

from bench.publish import stale
from engine.provenance import describe_machine
from engine.report import figures

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "bench" / "results"
FIGURES = ROOT / "bench" / "figures"


def processor(name: str) -> str:
    """Its name, and the widest vectors that it computes with: twice as many numbers at once may halve a time."""
    features = llvmlite.binding.get_host_cpu_features()
    widest = next((label for feature, label in (("avx512f", "AVX-512"), ("avx2", "AVX2")) if features.get(feature)), "")
    return f"{name} with {widest}" if widest else name


def stamp(name: str) -> str:
    """What measured which kernels, where and when."""
    made = describe_machine()
    versions = ", ".join(f"{p} {made[p]}" for p in ("Python", "numba", "numpy"))
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""  # 1 is the measurement itself
    return (
        f"`uv run python -m bench {name}`, {datetime.date.today()}, {processor(made['processor'])}, "
        f"{os.cpu_count()} cores{load}, {versions}, kernels {stale.measured_kernels()}"
    )


def publish(name: str, header: list[str], rows: list[list[str]], command: str = "", made: str = "") -> None:
    """Print a table, write it as CSV, and put it between its markers in README.md or a page of docs.

    command: the measurement that makes it, if that has another name.
    made: its stamp, if not all of it was measured now
    """
    made = made or stamp(command or name)
    RESULTS.mkdir(exist_ok=True)
    with open(RESULTS / f"{name}.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([f"# {made}"])
        writer.writerow(header)
        writer.writerows(rows)
    table = compose_table(header, rows, made)
    print(table, end="\n\n")
    begin, end = f"<!-- bench:{name} -->", f"<!-- /bench:{name} -->"
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        text = page.read_text("utf-8")
        if begin in text and end in text:
            before, after = text.partition(begin)[0], text.partition(end)[2]
            shown = table if page.parent == ROOT else table.replace("](bench/", "](../bench/")
            page.write_text(f"{before}{begin}\n{shown}\n{end}{after}", "utf-8")
    stale.mark_pages()


def compose_table(header: list[str], rows: list[list[str]], made: str) -> str:
    """A table in Markdown, with its caption."""
    lines = ["| " + " | ".join(row) + " |" for row in [header, ["---"] * len(header), *rows]]
    return "\n".join([*lines, "", made])


def read_table(name: str) -> str:
    """A table in Markdown, as it was published last, from its CSV."""
    with open(RESULTS / f"{name}.csv", newline="", encoding="utf-8") as file:
        (made,), header, *rows = csv.reader(file)
    return compose_table(header, rows, made.removeprefix("# "))


def pin() -> None:
    """Stay on one core, where the system lets us."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


@contextmanager
def figure(name: str, width: float, height: float, **panels: Any) -> Iterator[Any]:
    """Axes to draw on; then bench/figures/<name>.png. Sizes in inches; panels as of plt.subplots."""
    FIGURES.mkdir(exist_ok=True)
    with figures.open_figure(FIGURES / f"{name}.png", width, height, **panels) as axes:
        yield axes
