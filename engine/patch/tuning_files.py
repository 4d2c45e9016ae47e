"""Tunings of instruments: the Scala files that a keyboard names, as the frequencies of its keys."""

import warnings
from pathlib import Path
from typing import Any

from pydantic_core import InitErrorDetails

from engine.arithmetic.plain_numbers import power
from engine.bodies.table import make_fault
from engine.faults import PatchWarning
from engine.files import MB, UnreadableFile, read_bytes
from engine.instrument.expansion import keys_of
from engine.instrument.key_frequencies import pitch_of_a4
from engine.instrument.key_names import describe_keys, note_name
from engine.instrument.scala_files import (
    ScalaError,
    Scale,
    check_map,
    frequencies_of_keys,
    map_from_middle_c,
    read_keyboard_map,
    read_scale,
)
from engine.output_files import error_reason
from engine.wording import format_value, to_one_line

KEYS = "tuning", "keyboard_map"  # of a keyboard, that name files
EQUAL = Scale("equal temperament", tuple(power(2.0, n / 12) for n in range(1, 13)))  # of a map without a scale
MAX_FILE_BYTES = MB
MAX_REASON = 200

Faults = list[InitErrorDetails]


def fill_in_tuning(data: dict[str, Any], folder: Path) -> tuple[dict[str, Any], Faults]:
    """Return an instrument with the frequencies of its keys in place of the files of its tuning, and what is wrong with
    these. Keys that a map leaves out are said by a PatchWarning."""
    keyboard = data.get("keyboard")
    named = {key: keyboard[key] for key in KEYS if keyboard.get(key) is not None} if isinstance(keyboard, dict) else {}
    if not named or not all(isinstance(name, str) and name for name in named.values()):
        return data, []
    assert isinstance(keyboard, dict)
    if keyboard.get("frequencies") is not None:
        path = "keyboard", next(iter(named))
        message = f"{path[1]} and frequencies are both given"
        return data, [make_fault(path, named[path[1]], message, "give one of them")]
    try:
        a4 = pitch_of_a4(keyboard)
        found = read_tuning(named.get("tuning"), named.get("keyboard_map"), folder, a4)
    except TuningError as error:
        return data, [make_fault(("keyboard", error.key), named.get(error.key), error.message, error.remedy)]
    except (TypeError, ValueError):  # of an a4 that is no number, as validation says
        return data, []
    return data | {"keyboard": with_frequencies(keyboard, found)}, []


class TuningError(ValueError):
    """A file of a tuning cannot be used. key: of the keyboard, that names it"""

    def __init__(self, key: str, message: str, remedy: str) -> None:
        super().__init__(f"{message}; {remedy}")
        self.key, self.message, self.remedy = key, message, remedy


def read_tuning(scale: str | None, keyboard_map: str | None, folder: Path, a4: float) -> dict[int, float]:
    """Return the frequencies of the keys that sound, Hz. scale, keyboard_map: names of files, relative to a folder; a4:
    where the map says nothing, Hz. Raises TuningError."""
    tones = EQUAL if scale is None else _read("tuning", folder / scale, read_scale)
    degrees = map_from_middle_c(a4)
    if keyboard_map is not None:
        degrees = _read("keyboard_map", folder / keyboard_map, read_keyboard_map)
    try:
        check_map(tones, degrees)
        found = frequencies_of_keys(tones, degrees, a4)
    except ScalaError as error:
        raise TuningError(KEYS[keyboard_map is not None], f"{keyboard_map}: {error}", "give another map") from None
    beyond = [key for key, frequency in found.items() if not 0.0 < frequency <= 1e6]
    return {key: frequency for key, frequency in found.items() if key not in beyond}


def _read(key: str, path: Path, read: Any) -> Any:
    """Read what a file says. Raises TuningError."""
    what = "a scale, .scl" if key == "tuning" else "a keyboard map, .kbm"
    try:
        return read(read_bytes(path, MAX_FILE_BYTES).decode("latin-1"))
    except FileNotFoundError:
        name = to_one_line(str(path), MAX_REASON)
        raise TuningError(key, f"no such file: {name}", f"give {what}") from None
    except (OSError, UnreadableFile) as error:
        reason = to_one_line(error_reason(error), MAX_REASON)
        raise TuningError(key, f"cannot be read ({reason})", f"give {what}") from None
    except ScalaError as error:
        name = format_value(path.name)
        message, _, remedy = str(error).partition("; ")
        raise TuningError(key, f"{name} is not {what}: {message}", remedy or "see docs/instruments.md") from None


def with_frequencies(keyboard: dict[str, Any], found: dict[int, float]) -> dict[str, Any]:
    """Return a keyboard with the frequencies of its keys in place of its tuning. Keys that have none are said by a
    PatchWarning."""
    rest = {key: value for key, value in keyboard.items() if key not in (*KEYS, "frequencies")}
    try:
        keys = keys_of(rest)
    except (KeyError, TypeError, ValueError):  # as validation says
        keys = []
    if silent := [key for key in keys if key not in found]:
        left_out = f"keyboard: the tuning leaves out {describe_keys(silent)}, which are silent"
        warnings.warn(left_out, PatchWarning, stacklevel=2)
    return rest | {"frequencies": {note_name(key): found[key] for key in sorted(found)}}
