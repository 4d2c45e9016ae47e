"""Values and names of users in messages: on one line, and no longer than one reads."""

import math
import re
import sys
from collections.abc import Collection, Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

MAX_VALUE_CHARACTERS = 60
MAX_LISTED_NAMES = 12
EXPONENT = re.compile(r"e\+0*")


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


def format_limit(value: float) -> str:
    """A limit as one would write it: 1e9, not 1e+09."""
    return EXPONENT.sub("e", f"{value:g}")


def describe_range(
    ge: float | None = None, gt: float | None = None, le: float | None = None, lt: float | None = None
) -> str:
    """A range in plain words: "from 1 to 12", or "more than 0, at most 1e9"; "" if there is no limit."""
    if ge is not None and le is not None:
        return f"from {format_limit(ge)} to {format_limit(le)}"
    limits = {"at least": ge, "more than": gt, "at most": le, "less than": lt}
    return ", ".join(f"{words} {format_limit(limit)}" for words, limit in limits.items() if limit is not None)


def describe_violation(error: Mapping[str, Any]) -> str:
    """Describe the valid values, for an error of pydantic."""
    limits = {key: value for key, value in error.get("ctx", {}).items() if key in ("ge", "gt", "le", "lt")}
    if error["type"] == "literal_error":
        return str(error["ctx"]["expected"])
    return describe_range(**limits) or str(error["msg"])


def program_name() -> str:
    """Return the name of this program for messages: as it was started, or else as it is installed."""
    started = Path(sys.argv[0] if sys.argv else "")
    if started.name == "render.py":
        return started.name
    package = started.parent.name
    return f"python -m {package}" if started.name == "__main__.py" and package in ("engine", "fdh") else "fdh"


def json_safe(value: Any) -> Any:
    """A copy of a value with null for numbers that JSON has not: NaN and infinity."""
    if isinstance(value, dict):
        return {key: json_safe(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [json_safe(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
