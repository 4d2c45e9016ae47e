"""The index of a folder of variations: a CSV file with a row per point, valid whenever it is read."""

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from engine.features import FEATURES
from engine.save import replaced

STATISTICS = ("gain_db", "contact", "newton_mean", "newton_max", "unconverged", "energy_error")

Cell = float | int | str | None
Row = dict[str, str]


def columns(paths: list[str]) -> list[str]:
    """The header: number, the values by their paths, what came of it, features, statistics."""
    return ["number", *paths, "file", "status", "fingerprint", *FEATURES, *STATISTICS]


def foreign(path: Path, paths: list[str]) -> str:
    """What is wrong with an index that is there already, if it is one of something else."""
    if not path.exists():
        return ""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            header = next(csv.reader(file), [])
    except (OSError, ValueError, csv.Error):
        header = []
    right = "give another folder, or remove it"
    return "" if header == columns(paths) else f"{path} is an index of something else; {right}"


def read(path: Path) -> dict[int, Row]:
    """Rows by their number, all in the form of text; what was half-written when a run was killed is left out."""
    if not path.exists():
        return {}
    text = path.read_bytes().decode("utf-8", "replace")
    rows = csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1], newline=""), strict=False)
    return {
        int(row["number"]): row
        for row in rows
        if None not in row and None not in row.values() and row["number"].isdecimal()
    }


def write(path: Path, header: list[str], rows: dict[int, Row]) -> None:
    """Write all rows anew, in the order of their numbers."""
    with replaced(path) as part:
        part.write_text(line(header) + "".join(line(row.values()) for _, row in sorted(rows.items())), "utf-8")


def line(cells: Iterable[Cell]) -> str:
    """A line of the file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def shown(value: Cell) -> str:
    """A cell as text in one line, empty where nothing is; numbers that are measured have 9 digits."""
    return "" if value is None else f"{value:.9g}" if isinstance(value, float) else " ".join(str(value).split())
