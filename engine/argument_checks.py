"""Arguments of the Python interface: what is of no use is refused in a line that says what would be."""

import operator
from collections.abc import Mapping
from typing import Any


def checked_number(name: str, value: float) -> float:
    """A number. Raises TypeError if it is none, ValueError if it is too large for one."""
    try:
        if isinstance(value, str | bytes | bool):
            raise TypeError
        return float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} = {value!r} is not a number; give one, such as 1.0") from None
    except OverflowError:
        raise ValueError(f"{name} is out of range; it has more digits than a number holds") from None


def checked_integer(name: str, value: int) -> int:
    """A whole number. Raises TypeError if it is none."""
    try:
        if isinstance(value, bool):
            raise TypeError
        return operator.index(value)
    except TypeError:
        raise TypeError(f"{name} = {value!r} is not a whole number; give one, such as 0") from None


def values_by_path(path: Any, value: Any) -> dict[Any, Any]:
    """The values to set: one, by its path, or those of a dict in place of a path. Raises ValueError if there is one
    beside the dict, which it would not be of."""
    if not isinstance(path, Mapping):
        return {path: value}
    if value is not None:
        raise ValueError(f"value = {value!r} belongs to no path; leave it out, or put it into the dict of values")
    return dict(path)


def plain_value(value: Any) -> Any:
    """A value as a patch has it: numbers and arrays of NumPy, and tuples, become numbers and lists."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain_value(inner) for inner in value] if isinstance(value, list | tuple) else value
