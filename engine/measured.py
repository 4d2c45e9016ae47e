"""Measured modes from a CSV file."""

import csv
from pathlib import Path
from typing import Any


def read(path: Path) -> dict[str, Any]:
    """Columns of a CSV file with a header: frequency (Hz), sigma (1/s) or t60 (s), and a mode shape
    (1/√kg) per point, under its name. Returns them by the keys of a `modes` body.

    Raises ValueError, which says what is wrong and in which line.
    """
    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file) if row and not row[0].lstrip().startswith("#")]
    if len(rows) < 2:
        raise ValueError("it needs a header and at least one mode")
    header = [name.strip() for name in rows[0]]
    if "frequency" not in header:
        raise ValueError(f"no column frequency; its columns are {', '.join(header)}")
    columns: dict[str, list[float]] = {name: [] for name in header}
    if len(columns) < len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise ValueError(f'two columns are named "{twice}"')
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(header):
            raise ValueError(f"mode {number} has {len(row)} entries, the header {len(header)}")
        for name, text in zip(header, row, strict=True):
            try:
                columns[name].append(float(text))
            except ValueError:
                raise ValueError(f'mode {number}: {name} is "{text}", not a number') from None
    own = {name: columns.pop(name) for name in ("frequency", "sigma", "t60") if name in columns}
    return own | {"points": columns}
