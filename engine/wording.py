"""Words of others in messages of ours: on one line, and no longer than one reads."""

from collections.abc import Collection
from itertools import islice
from typing import Any

VALUE = 60  # characters of a value
NAMES = 12  # of a list


def one_line(text: str, most: int) -> str:
    """A text on one line, cut if it is long. What does not print, such as a line's end, is written as Python does."""
    kept = text if len(text) <= most else text[: most - 3] + "..."
    return kept if kept.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in kept)


def shown(value: Any, most: int = VALUE) -> str:
    """A value of a patch, as one would write it there."""
    if isinstance(value, bool):
        return str(value).lower()
    try:
        text = f'"{value}"' if isinstance(value, str) else str(value)
    except (ValueError, RecursionError):  # a number of thousands of digits, from Python
        text = f"this {type(value).__name__}"
    return one_line(text, most)


def listed(names: Collection[str]) -> str:
    """The names there are: the first of them, if they are many."""
    some = ", ".join(shown(name) for name in islice(names, NAMES)) or "none"
    return some if len(names) <= NAMES else f"{some} and {len(names) - NAMES} more"
