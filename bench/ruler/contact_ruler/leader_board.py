"""Rows of a leader board: the scores of methods, as anyone may add them (docs/ruler.md)."""

import csv
import io
import platform

from bench.ruler.contact_ruler.library import VERSION
from bench.ruler.contact_ruler.score import Score

COLUMNS = ["version", "problem", "method", "setting", "author", "machine", "link"]
MEASURES = ["motion", "force", "bands_db", "energy", "pull", "ns_per_sample", "failed"]


def format_row(problem: str, score: Score, method: str, author: str, setting: str = "", link: str = "") -> str:
    """Return the score of a method on a problem as a line of CSV, in the order of COLUMNS and MEASURES."""
    machine = f"{platform.machine()}, {platform.python_implementation()} {platform.python_version()}"
    values = [score[name] for name in MEASURES]
    numbers = [value if isinstance(value, str) else f"{value:.3g}" for value in values]
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow([VERSION, problem, method, setting, author, machine, link, *numbers])
    return line.getvalue()
