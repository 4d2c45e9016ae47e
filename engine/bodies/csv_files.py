"""CSV files that a patch names: measured modes, and shapes that bodies begin with."""

import csv
import io
from itertools import pairwise
from pathlib import Path
from typing import Any

from engine.bodies.measured import MAX_POINTS
from engine.files import MB, read_bytes
from engine.wording import format_names, format_value

MAX_CSV_BYTES = 16 * MB  # a thousand modes at a thousand points


def read_modes(path: Path) -> dict[str, Any]:
    """Read measured modes from a CSV file, and return them by the keys of a `modes` body.

    The file has a header and a row per mode, with columns frequency (Hz), sigma (1/s) or t60 (s), and a mode shape
    (1/√kg) per point, under the name of the point.

    Raises OSError, or ValueError, which says what is wrong and with which mode.
    """
    columns = _read_columns(path, "mode", ("frequency",))
    modes = {name: columns.pop(name) for name in ("frequency", "sigma", "t60") if name in columns}
    return modes | {"points": columns}


def read_shape(path: Path) -> dict[str, Any]:
    """Read a shape from a CSV file, and return it by the keys of an initial displacement or velocity.

    The file has a header and a row per point, with columns x (and y of a sheet), fractions, and value (m or m/s).

    Raises OSError, or ValueError, which says what is wrong and with which point.
    """
    columns = _read_columns(path, "point", ("x", "value"))
    if unknown := columns.keys() - {"x", "y", "value"}:
        raise ValueError(f"its columns are x, y and value; not {format_names(sorted(unknown))}")
    return dict(columns)


def _read_columns(path: Path, item: str, required: tuple[str, ...]) -> dict[str, list[float]]:
    """The columns of a CSV file by their names. item: what a row is of. Raises OSError or ValueError."""
    rows = _read_rows(path)
    if len(rows) < 2:
        raise ValueError(f"it needs a header and at least one {item}")
    if len(rows[0]) > MAX_POINTS:
        raise ValueError(f"it has {len(rows[0])} columns; at most {MAX_POINTS}")
    header = [name.strip() for name in rows[0]]
    for name in required:
        if name not in header:
            raise ValueError(f"no column {name}; its columns are {format_names(header)}")
    if len(set(header)) < len(header):
        twice = next(name for name, after in pairwise(sorted(header)) if name == after)
        raise ValueError(f"two columns are named {format_value(twice)}")
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(header):
            raise ValueError(f"{item} {number} has {len(row)} entries, the header {len(header)}")
    return {name: _parse_column(item, name, [row[i] for row in rows[1:]]) for i, name in enumerate(header)}


def _read_rows(path: Path) -> list[list[str]]:
    """The rows of a CSV file, without comments. Raises OSError or ValueError."""
    try:
        text = read_bytes(path, MAX_CSV_BYTES).decode("utf-8-sig")
        return [row for row in csv.reader(io.StringIO(text, "")) if row and not row[0].lstrip().startswith("#")]
    except UnicodeDecodeError:
        raise ValueError("it is not a text file in UTF-8") from None
    except csv.Error as error:
        raise ValueError(str(error)) from None


def _parse_column(item: str, name: str, column: list[str]) -> list[float]:
    """The numbers of a column, given as text. Raises ValueError."""
    numbers = []
    for number, text in enumerate(column, 1):
        try:
            numbers.append(float(text))
        except ValueError:
            raise ValueError(
                f"{item} {number}: {format_value(name)[1:-1]} is {format_value(text)}, not a number"
            ) from None
    return numbers
