"""`uv run python -m bench compare OLD NEW`: which times have moved by more than noise between two sets of results.

OLD and NEW are folders of results, or revisions of the repository that hold them in bench/results.
"""

import csv
import io
import subprocess
import sys
from pathlib import Path

from bench.publish.report import ROOT

TABLE = "realtime.csv"  # its first columns: the patch, and the ns per sample of the fastest run and of the median one
NOISE = 0.05  # of a time, at least


def times(where: str) -> dict[str, tuple[float, float]]:
    """ns per sample of every patch: fastest run and median run.

    Raises OSError, CalledProcessError or ValueError if there are none.
    """
    folder = Path(where)
    if folder.is_dir():
        text = (folder / TABLE).read_text("utf-8")
    else:
        words = ["git", "show", f"{where}:bench/results/{TABLE}"]
        text = subprocess.run(words, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    _, *rows = csv.reader(line for line in io.StringIO(text) if not line.lstrip('"').startswith("#"))
    return {patch: (float(fastest), float(median)) for patch, fastest, median, *_ in rows}


def compared(old: dict[str, tuple[float, float]], new: dict[str, tuple[float, float]]) -> list[tuple[str, float, str]]:
    """Ratio of new to old for each patch, and what it means; noise is how far a median lies above its least."""
    found = []
    for name in sorted(old.keys() & new.keys()):
        (least, median), (least_now, median_now) = old[name], new[name]
        noise = max(NOISE, median / least - 1, median_now / least_now - 1)
        ratio = least_now / least
        moved = "SLOWER" if ratio > 1 + noise else "faster" if ratio < 1 / (1 + noise) else ""
        found.append((name, ratio, moved))
    return found


def main(words: list[str]) -> int:
    """Print ratios; 1 if anything is slower, 2 if there is nothing to compare."""
    if len(words) != 2:
        print("bench compare: give two folders of results, or revisions: compare OLD NEW", file=sys.stderr)
        return 2
    both = []
    for where in words:
        try:
            both.append(times(where))
        except (OSError, subprocess.CalledProcessError, ValueError) as error:
            print(
                f"bench compare: there are no times in {where} ({error}); give a folder with {TABLE}, or a revision",
                file=sys.stderr,
            )
            return 2
    found = compared(*both)
    for name, ratio, moved in found:
        print(f"{name:<24} {ratio:6.3f}  {moved}")
    for name in sorted(both[0].keys() ^ both[1].keys()):
        print(f"{name:<24} only in {words[0] if name in both[0] else words[1]}")
    return 1 if any(moved == "SLOWER" for _, _, moved in found) else 0
