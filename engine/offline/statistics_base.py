"""Typed results that are also read by name, as `--json` prints them."""

from dataclasses import fields
from typing import Any


class Statistics:
    """The base of frozen dataclasses: `statistics.peak` and `statistics["peak"]` are the same."""

    def __getitem__(self, name: str) -> Any:
        """A value by its name. Raises KeyError."""
        if name.startswith("_") or not hasattr(self, name):
            raise KeyError(name)
        return getattr(self, name)

    def __contains__(self, name: str) -> bool:
        return any(field.name == name for field in fields(self))  # type: ignore[arg-type]

    def as_dict(self) -> dict[str, Any]:
        """All values by their names, records among them as dicts too."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return {name: _as_plain(value) for name, value in values.items()}


def _as_plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_as_plain(item) for item in value]
    return value.as_dict() if isinstance(value, Statistics) else value
