"""Rules of `[[control]]`, and of events, that only the whole patch can break: what may change, and how far."""

import re
from collections.abc import Iterator
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies.table import make_fault
from engine.instrument.key_names import PART_SEPARATOR
from engine.patch.live_parameters import LivePath, explain_unknown, live_paths, with_value

Faults = Iterator[InitErrorDetails]

MAX_MPE_CHANNELS = 14  # members of two zones together: each has a master of its own
KEY_NAME = r"[A-G]s?m?\d+_"


def paths_of_keys(paths: dict[str, LivePath], parameter: str) -> list[str]:
    """The live parameters that a path stands for: itself; or in an instrument, that of each key and copy."""
    if parameter in paths or parameter.count(".") < 2:
        return [parameter] if parameter in paths else []
    section, name, rest = map(re.escape, parameter.split(".", 2))
    part, separator, own = name.rpartition(PART_SEPARATOR)
    pattern = re.compile(rf"{section}\.({KEY_NAME}{name}|{part}{separator}{KEY_NAME}{own})\d*\.{rest}")
    return [path for path in paths if pattern.fullmatch(path)]


def check_changes(scene: Any) -> Faults:
    """All faults of the events of a scene that change a live parameter."""
    changes = [(i, event) for i, event in enumerate(scene.event) if getattr(event, "parameter", None) is not None]
    paths = live_paths(scene, True) if changes else {}
    for i, event in changes:
        if event.parameter not in paths:
            message, _, remedy = explain_unknown(event.parameter, list(paths)).partition("; ")
            yield make_fault(("event", i, "parameter"), event.parameter, message, f"{remedy}; see fdh params")
            continue
        try:
            with_value(scene, paths[event.parameter], event.parameter, event.value)
        except ValueError as error:
            message, _, remedy = str(error).partition("; ")
            yield make_fault(("event", i, "value"), event.value, message, remedy)


def as_plain_change(event: Any, paths: dict[str, LivePath]) -> Any:
    """A change by the path of a parameter; of one that the audio thread glides, as one of its contact or connection."""
    if getattr(event, "parameter", None) is None:
        return event
    path = paths[event.parameter]
    if not path.is_glided:
        return event
    return event.model_copy(
        update={"parameter": None, "value": None, path.section: path.name, str(path.keys[0]): event.value}
    )


def check_controls(scene: Any) -> Faults:
    """All faults of the controls of a scene that is valid but for these."""
    paths = live_paths(scene)
    for i, control in enumerate(scene.control):
        place = ("control", i)
        chosen = paths_of_keys(paths, control.parameter)
        if not chosen:
            message, _, remedy = explain_unknown(control.parameter, list(paths)).partition("; ")
            yield make_fault((*place, "parameter"), control.parameter, message, f"{remedy}; see fdh params")
            continue
        low, high = control.range
        for value in (low, high):
            try:
                with_value(scene, paths[chosen[0]], control.parameter, value)
            except ValueError as error:
                message, _, remedy = str(error).partition("; ")
                yield make_fault((*place, "range"), control.range, message, remedy)
        if control.curve == "exponential" and not low * high > 0.0:
            message = f"an exponential curve cannot go from {low:g} to {high:g}"
            yield make_fault((*place, "range"), control.range, message, "give two numbers above 0, or a linear curve")
        if control.kind == "osc" and control.input[0] == control.input[1]:
            yield make_fault((*place, "input"), control.input, "both ends are equal", "give two different numbers")
    if scene.midi.mpe_lower and scene.midi.mpe_upper and scene.midi.mpe_lower + scene.midi.mpe_upper > MAX_MPE_CHANNELS:
        message = f"two zones of {scene.midi.mpe_lower} and {scene.midi.mpe_upper} channels"
        yield make_fault(("midi", "mpe_upper"), scene.midi.mpe_upper, message, "give at most 14 in total")
