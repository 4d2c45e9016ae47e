"""Measured modes from a CSV file."""

import csv
import io
from itertools import pairwise
from pathlib import Path
from typing import Any

from engine.files import MB, content
from engine.parts import MEASURED
from engine.wording import listed, shown

LARGEST = 16 * MB  # of a file: a thousand modes at a thousand places


def read(path: Path) -> dict[str, Any]:
    """Columns of a CSV file with a header: frequency (Hz), sigma (1/s) or t60 (s), and a mode shape
    (1/√kg) per point, under its name. Returns them by the keys of a `modes` body.

    Raises OSError, or ValueError, which says what is wrong and in which line.
    """
    rows = _rows(path)
    if len(rows) < 2:
        raise ValueError("it needs a header and at least one mode")
    if len(rows[0]) > MEASURED:
        raise ValueError(f"it has {len(rows[0])} columns; at most {MEASURED}")
    header = [name.strip() for name in rows[0]]
    if "frequency" not in header:
        raise ValueError(f"no column frequency; its columns are {listed(header)}")
    if len(set(header)) < len(header):
        twice = next(name for name, after in pairwise(sorted(header)) if name == after)
        raise ValueError(f"two columns are named {shown(twice)}")
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(header):
            raise ValueError(f"mode {number} has {len(row)} entries, the header {len(header)}")
    columns = {name: _numbers(name, [row[i] for row in rows[1:]]) for i, name in enumerate(header)}
    own = {name: columns.pop(name) for name in ("frequency", "sigma", "t60") if name in columns}
    return own | {"points": columns}


def _rows(path: Path) -> list[list[str]]:
    """The rows, without comments. Raises OSError or ValueError."""
    try:
        text = content(path, LARGEST).decode("utf-8-sig")
        return [row for row in csv.reader(io.StringIO(text, "")) if row and not row[0].lstrip().startswith("#")]
    except UnicodeDecodeError:
        raise ValueError("it is not a text file in UTF-8") from None
    except csv.Error as error:
        raise ValueError(str(error)) from None


def _numbers(name: str, column: list[str]) -> list[float]:
    """A column as numbers. Raises ValueError."""
    found = []
    for number, text in enumerate(column, 1):
        try:
            found.append(float(text))
        except ValueError:
            raise ValueError(f"mode {number}: {shown(name)[1:-1]} is {shown(text)}, not a number") from None
    return found
