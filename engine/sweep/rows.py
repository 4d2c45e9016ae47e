"""A sweep as a table: a row per point, with numbers as numbers. It needs no extra."""

from pathlib import Path
from typing import Any

from engine.analysis.features import FEATURE_NAMES, TEXT_NAMES
from engine.sweep.index_csv import STATISTIC_NAMES, IndexRow, contact_columns, read_index

SweepRow = dict[str, Any]  # numbers, words or None by column

MEASURE_NAMES = (*FEATURE_NAMES, *STATISTIC_NAMES, "trusted")
WORD_NAMES = (*TEXT_NAMES, "reasons")
LATER_NAMES = {"capped", "trusted", *WORD_NAMES}  # that the index of an earlier version lacks
COUNT_NAMES = ("silent", "newton_max", "unconverged", "capped", "trusted")  # of the measures: whole numbers


def read_sweep_rows(folder: str | Path) -> list[SweepRow]:
    """Read the folder of a sweep as a list of dicts, one per point, as `csv.DictWriter` and pandas.DataFrame take them.

    folder: that `fdh sweep` or `run_sweep_rows` has written, done or not

    A row has the number of the point, its values by their paths, `file`, `status` and `reasons`, and the features and
    statistics of index.csv in the units of `read_sweep`. Numbers are int or float, words are str, and what is missing
    or not defined is None.

    Raises TypeError or ValueError if the folder is none of a sweep.

    >>> import fdh
    >>> scene = fdh.load("bouncing_ball")
    >>> done = fdh.run_sweep_rows(scene, {"body.ball.mass": [0.1, 0.2]}, "balls", seconds=0.5)
    >>> rows = fdh.read_sweep_rows("balls")
    >>> [(row["body.ball.mass"], row["status"], row["fundamental_hz"]) for row in rows]
    [(0.1, 'done', None), (0.2, 'done', None)]
    >>> rows == done
    True
    """
    rows = read_index_rows(folder)
    paths = varied_paths(rows)
    numeric = {path for path in paths if all(is_number(row[path]) for row in rows)}
    return [_typed_row(row, paths, numeric) for row in rows]


def read_index_rows(folder: str | Path) -> list[IndexRow]:
    """The rows of the index of a sweep in the order of their points, as text. Raises TypeError, ValueError."""
    if not isinstance(folder, str | Path):
        raise TypeError(f"{folder!r} is not a path; give the folder of a sweep")
    rows = [row for _, row in sorted(read_index(Path(folder) / "index.csv").items())]
    if not rows or not {"number", "file", "status", *MEASURE_NAMES} - LATER_NAMES <= set(rows[0]):
        raise ValueError(
            f"{folder} holds no sweep; give a folder that fdh sweep has written, with an index.csv of rows"
        )
    return [row | {name: row.get(name, "") for name in LATER_NAMES} for row in rows]


def varied_paths(rows: list[IndexRow]) -> list[str]:
    """The paths of the values that varied."""
    columns = list(rows[0])
    return columns[1 : columns.index("file")]


def is_number(text: str) -> bool:
    """True if a cell holds a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _typed_row(row: IndexRow, paths: list[str], numeric: set[str]) -> SweepRow:
    """A row with cells of the right types. numeric: the paths of which all values are numbers"""
    values: SweepRow = {path: _number(row[path]) if path in numeric else row[path] for path in paths}
    texts: SweepRow = {"file": row["file"] or None, "status": row["status"], "reasons": row["reasons"]}
    texts |= {name: row[name] or None for name in TEXT_NAMES}
    measures: SweepRow = {name: float(row[name]) if row[name] else None for name in MEASURE_NAMES}
    counts: SweepRow = {name: int(float(row[name])) if row[name] else None for name in COUNT_NAMES}
    contacts: SweepRow = {name: float(row[name]) if row[name] else None for name in contact_columns(row)}
    touches = {name: int(value) for name, value in contacts.items() if name.endswith(".touches") and value is not None}
    return {"number": int(row["number"])} | values | texts | measures | counts | contacts | touches


def _number(text: str) -> float | int:
    """A value as it was given: a whole number without a point stays one."""
    return int(text) if text.lstrip("-").isdecimal() else float(text)
