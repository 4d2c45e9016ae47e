"""The index of a folder of variations: a CSV file with a row per point, valid whenever it is read."""

import csv
import io
import re
from collections.abc import Iterable
from pathlib import Path

from engine.features import FEATURES
from engine.save import replaced

STATISTICS = ("gain_db", "contact", "newton_mean", "newton_max", "unconverged", "energy_error")

LONGEST = 1 << 20  # characters of a line that is read

NUMBER = re.compile("[0-9]{1,9}")

Cell = float | int | str | None
Row = dict[str, str]


def columns(paths: list[str]) -> list[str]:
    """The header: number, the values by their paths, what came of it, features, statistics."""
    return ["number", *paths, "file", "status", "fingerprint", *FEATURES, *STATISTICS]


def foreign(path: Path, paths: list[str]) -> str:
    """What is wrong with an index that is there already, if it is one of something else."""
    if not path.exists():
        return ""
    header: list[str] | None = None
    if path.is_file():  # not a pipe, which would be waited for
        try:
            with open(path, newline="", encoding="utf-8", errors="replace") as file:
                header = cells(file.readline(LONGEST))
        except OSError:
            pass
    right = "give another folder, or remove it"
    return "" if header == columns(paths) else f"{path} is an index of something else; {right}"


def read(path: Path) -> dict[int, Row]:
    """Rows by their number, all in the form of text; what is no row of ours, or was half-written when a run was killed,
    is left out. The file of a row that has one is that of its number, in this folder."""
    if not path.is_file():
        return {}
    found = {}
    with open(path, newline="\n", encoding="utf-8", errors="replace") as file:
        header = cells(file.readline(LONGEST)) or []
        while text := file.readline(LONGEST):
            row = cells(text) if text.endswith("\n") else None
            if row is None or len(row) != len(header):
                continue
            told = dict(zip(header, row, strict=True))
            if NUMBER.fullmatch(told["number"]) and told["file"] in ("", sound(int(told["number"]))):
                found[int(told["number"])] = told
    return found


def cells(text: str) -> list[str] | None:
    """The cells of a line; None if it is none of ours."""
    try:
        return next(csv.reader([text]), None)
    except csv.Error:  # such as a cell of more than 131072 characters
        return None


def sound(number: int) -> str:
    """Name of the file of a point."""
    return f"{number:04d}.wav"


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
