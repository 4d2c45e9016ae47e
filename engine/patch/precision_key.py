"""The key `precision` of [accuracy], which chose single precision, and has no effect any more."""

import sys
import warnings
from typing import Any

from engine.faults import PatchWarning

PATH = "accuracy", "precision"
WHY = "everything is rendered in double precision, because single precision was slower at 40, 400 and 4000 modes"
NOTE = f"has no effect any more: {WHY}"
ON_THE_WAY = "engine", "fdh", "pydantic"  # packages between a caller and the settings


def remove_precision(document: dict[str, Any]) -> bool:
    """Remove the key from a patch. Returns True if it was there."""
    accuracy = document.get(PATH[0])
    return isinstance(accuracy, dict) and accuracy.pop(PATH[1], None) is not None


def drop_precision(settings: Any) -> Any:
    """Return settings of accuracy without the key. If they have it, the caller of the engine gets a PatchWarning."""
    if not isinstance(settings, dict) or PATH[1] not in settings:
        return settings
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] in ON_THE_WAY:
        level, frame = level + 1, frame.f_back
    warnings.warn(f"{'.'.join(PATH)}: {NOTE}", PatchWarning, stacklevel=level)
    return {key: value for key, value in settings.items() if key != PATH[1]}
