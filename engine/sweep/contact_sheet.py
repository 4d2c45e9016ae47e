"""The contact sheet of a sweep: a page in its folder that plays its sounds, with their waveforms and values."""

import json
from html import escape
from itertools import pairwise
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from engine.output_files import soundfile_path, write_text
from engine.sweep.index_csv import IndexRow, read_index

NAME = "index.html"
TEMPLATE = "contact_sheet.html"
BARS = 64  # of a waveform
LEVELS = 90  # of a bar: a printable character each, from "#" on
FIRST_CHARACTER = 35
FEATURES = ("peak", "fundamental_hz", "centroid_hz", "t60_s")  # of the index


def write_contact_sheet(folder: Path, title: str, paths: list[str]) -> Path:
    """Write the page of the sounds in the folder of a sweep. paths: of the values that vary. Returns its path. Raises
    OSError if it cannot be written."""
    rows = [row for _, row in sorted(read_index(folder / "index.csv").items()) if row["status"] == "done"]
    columns = [*paths, *FEATURES]
    listed = [
        {"file": row["file"], "peaks": draw_waveform(folder / row["file"]), "cells": [_cell(row, c) for c in columns]}
        for row in rows
    ]
    data = json.dumps({"columns": columns, "rows": listed}).replace("<", "\\u003c")
    write_text(folder / NAME, Template(page_template()).substitute(title=escape(title), data=data))
    return folder / NAME


def page_template() -> str:
    """Return the page, with $title and $data where these belong."""
    return Path(__file__).with_name(TEMPLATE).read_text("utf-8")


def _cell(row: IndexRow, column: str) -> Any:
    """A cell as a number, if it is one."""
    try:
        return float(row[column])
    except ValueError:
        return row[column]


def draw_waveform(path: Path) -> str:
    """Return the waveform of a sound file, a character for each bar; "" if the file cannot be read."""
    import soundfile

    try:
        audio, _ = soundfile.read(soundfile_path(path), always_2d=True, dtype="float32")
    except (OSError, RuntimeError):
        return ""
    size = np.abs(audio).max(axis=1, initial=0.0)
    edges = np.linspace(0, len(size), BARS + 1).astype(int)
    bars = np.array([size[a:b].max(initial=0.0) for a, b in pairwise(edges)])
    loudest = bars.max(initial=0.0) or 1.0
    return "".join(chr(FIRST_CHARACTER + round(LEVELS * bar / loudest)) for bar in bars.tolist())
