"""Values and names of users in messages: on one line, and no longer than one reads."""

import math
import sys
from collections.abc import Collection, Iterable
from itertools import islice
from pathlib import Path
from typing import Any

MAX_VALUE_CHARACTERS = 60
MAX_LISTED_NAMES = 12


def to_one_line(text: str, max_characters: int) -> str:
    """A text on one line, cut if it is long. What does not print, such as a line's end, is escaped as in Python."""
    cut = text if len(text) <= max_characters else text[: max_characters - 3] + "..."
    return cut if cut.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in cut)


def format_value(value: Any, max_characters: int = MAX_VALUE_CHARACTERS) -> str:
    """A value of a patch, as one would write it there."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        text = f'"{value}"' if isinstance(value, str) else str(value)
    except (ValueError, RecursionError):  # Python refuses to print numbers of thousands of digits
        text = f"this {type(value).__name__}"
    return to_one_line(text, max_characters)


def format_names(names: Collection[str]) -> str:
    """A list of names in quotes; only the first of them, if they are many."""
    text = ", ".join(format_value(name) for name in islice(names, MAX_LISTED_NAMES)) or "none"
    return text if len(names) <= MAX_LISTED_NAMES else f"{text} and {len(names) - MAX_LISTED_NAMES} more"


def join_with_or(words: Iterable[str]) -> str:
    """Alternatives as part of a sentence: "a, b or c"."""
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last


def program_name() -> str:
    """How messages name this program: as it was started, or else as it is installed."""
    started = Path(sys.argv[0] if sys.argv else "")
    if started.name == "render.py":
        return started.name
    return "python -m engine" if started.parts[-2:] == ("engine", "__main__.py") else "fdh"


def json_safe(value: Any) -> Any:
    """A copy of a value with null for numbers that JSON has not: NaN and infinity."""
    if isinstance(value, dict):
        return {key: json_safe(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [json_safe(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
