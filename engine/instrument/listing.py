"""Lists an instrument at one key: every number that its formulas and tables give."""

from typing import Any

from engine.instrument.key_names import note_name
from engine.instrument.key_sequencer import FULL_VELOCITY, events_of_key
from engine.instrument.key_writer import SECTIONS, KeyWriter


class KeyFault(ValueError):
    """A value that has none at the key. `faults`: as pydantic has them."""

    def __init__(self, faults: list[Any]) -> None:
        super().__init__(f"{'.'.join(map(str, faults[0]['loc']))}: {faults[0]['type'].message()}")
        self.faults = faults


def list_key(document: dict[str, Any], key: int, velocity: int) -> dict[str, Any]:
    """List the tables of a key of an instrument, and its events when it is pressed at a velocity of 1 to 127 and
    released.

    Raises KeyFault.
    """
    bare = {name: value for name, value in document.items() if name not in SECTIONS}
    writer = KeyWriter(bare)
    writer.write_key(key)
    note = {"v": velocity / FULL_VELOCITY, "soft": 0.0, "release": 0.5}
    listing: dict[str, Any] = {"key": note_name(key), "velocity": velocity, "values": writer.names(key) | note}
    listing |= {section: writer.sections[section] for section in SECTIONS}
    for name in ("on", "off", "damper"):
        listing[name] = [event for event, _, _ in events_of_key(writer, name, key, note)]
    if writer.faults:
        raise KeyFault(writer.faults)
    return listing


def format_listing(listing: dict[str, Any]) -> list[str]:
    """The listing as lines to read, in the form of a patch."""
    lines = [f"# {listing['key']}, velocity {listing['velocity']}", "", "[values]"]
    lines += [f"{name} = {_format(value)}" for name, value in listing["values"].items()]
    for section in (*SECTIONS, "on", "off", "damper"):
        for table in listing[section]:
            lines += ["", f"[[{section}]]", *(f"{name} = {_format(value)}" for name, value in table.items())]
    return lines


def _format(value: Any) -> str:
    """A value as in a patch; numbers to seven digits."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return f"[{', '.join(map(_format, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{name} = {_format(inner)}' for name, inner in value.items())} }}"
    return str(value)
