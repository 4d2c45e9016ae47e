"""The index of a folder of variations: a CSV file with a row per point, valid whenever it is read."""

import csv
import io
import re
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

from engine.analysis.contact_summaries import ContactSummary
from engine.analysis.features import FEATURE_NAMES, TEXT_NAMES
from engine.output_files import atomic_write

STATISTIC_NAMES = ("gain_db", "contact", "newton_mean", "newton_max", "unconverged", "capped", "energy_error")
TRUST_NAMES = ("trusted", "reasons")  # whether nothing speaks against a rendering, and what does

MAX_LINE_CHARACTERS = 1 << 20
CONTACT_MEASURES = tuple(field.name for field in fields(ContactSummary))

POINT_NUMBER = re.compile("[0-9]{1,9}")

Cell = float | int | str | None
IndexRow = dict[str, str]  # cells by column


def index_header(paths: list[str], contacts: Iterable[str] = ()) -> list[str]:
    """The columns: the number of the point, its values by their paths, its result, features and statistics, and the
    measures of contacts, by their names."""
    measures = (*FEATURE_NAMES, *TEXT_NAMES, *STATISTIC_NAMES, *TRUST_NAMES)
    of_contacts = (f"{name}.{measure}" for name in contacts for measure in CONTACT_MEASURES)
    return ["number", *paths, "file", "status", "fingerprint", *measures, *of_contacts]


def contact_columns(header: Iterable[str]) -> list[str]:
    """The columns of an index that are measures of contacts."""
    names = list(header)
    known = names.index("fingerprint") if "fingerprint" in names else 0
    return [name for name in names[known:] if name.rpartition(".")[2] in CONTACT_MEASURES and "." in name]


def check_index(path: Path, paths: list[str]) -> str:
    """Explain why an index cannot be written, if there is one of a sweep over other paths already; else ""."""
    if not path.exists():
        return ""
    header: list[str] | None = None
    if path.is_file():  # not a pipe, which blocks
        try:
            with open(path, newline="", encoding="utf-8", errors="replace") as file:
                header = parse_line(file.readline(MAX_LINE_CHARACTERS))
        except OSError:
            pass
    if header is None or header[: len(paths) + 4] != index_header(paths)[: len(paths) + 4]:
        return f"{path} is an index of something else; give another folder, or remove it"
    if any(row["file"] == f"{number:04d}.wav" for number, row in read_index(path).items()):
        reason = "is of an earlier version, which named sounds only by numbers and scaled each sound by itself"
        return f"{path} {reason}; give another folder, or remove this one"
    return ""


def read_index(path: Path) -> dict[int, IndexRow]:
    """Rows of an index by the number of their point; all cells are text. Left out are lines that are no row of a
    sweep, or were half-written when one was killed."""
    if not path.is_file():
        return {}
    rows = {}
    with open(path, newline="\n", encoding="utf-8", errors="replace") as file:
        header = parse_line(file.readline(MAX_LINE_CHARACTERS)) or []
        while line := file.readline(MAX_LINE_CHARACTERS):
            cells = parse_line(line) if line.endswith("\n") else None
            if cells is None or len(cells) != len(header):
                continue
            row = dict(zip(header, cells, strict=True))
            if POINT_NUMBER.fullmatch(row["number"]):
                rows[int(row["number"])] = row
    return rows


def parse_line(text: str) -> list[str] | None:
    """The cells of a line; None if it is no CSV."""
    try:
        return next(csv.reader([text]), None)
    except csv.Error:  # such as a cell of more than 131072 characters
        return None


def write_index(path: Path, header: list[str], rows: dict[int, IndexRow]) -> None:
    """Write the whole index anew, in the order of the numbers. Raises OSError."""
    with atomic_write(path) as temporary:
        lines = (csv_line(row.get(column, "") for column in header) for _, row in sorted(rows.items()))
        temporary.write_text(csv_line(header) + "".join(lines), "utf-8")


def csv_line(cells: Iterable[Cell]) -> str:
    """A line of the file, with its end."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def format_cell(value: Cell) -> str:
    """A cell as text on one line: "" for None; measured numbers have 9 digits."""
    return "" if value is None else f"{value:.9g}" if isinstance(value, float) else " ".join(str(value).split())
