"""Rules of forces that no key shows alone. Tables are as they were read."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies.table import KeyPath, are_positive, is_number, make_fault

MIN_BAND, MAX_BAND = 1.0, 23_000.0  # Hz, of a noise: it is drawn at 48 kHz (engine.assembly.external_forces)

Faults = Iterator[InitErrorDetails]


def check_force(path: KeyPath, force: dict[str, Any]) -> Faults:
    """A force fades within its duration, its envelope goes forwards in time, and its band from low to high."""
    fade: Any = force.get("fade")
    duration: Any = force.get("duration")
    if is_number(fade) and is_number(duration) and fade > duration / 2 > 0.0:
        message = f"{fade:g} s to rise and {fade:g} s to fall in {duration:g} s"
        yield make_fault((*path, "fade"), fade, message, "give at most half of the duration")
    yield from _check_envelope((*path, "envelope"), force.get("envelope"))
    band = force.get("band")
    if are_positive(band) and len(band) == 2 and not MIN_BAND <= band[0] < band[1] <= MAX_BAND:
        message = f"{band[0]:g} Hz to {band[1]:g} Hz"
        remedy = f"give the lower first, from {MIN_BAND:g} Hz to {MAX_BAND:g} Hz"
        yield make_fault((*path, "band"), band, message, remedy)


def _check_envelope(path: KeyPath, envelope: Any) -> Faults:
    """The times of an envelope rise from 0 or later."""
    if not isinstance(envelope, list):
        return
    times = [point[0] for point in envelope if isinstance(point, list) and len(point) == 2 and is_number(point[0])]
    if len(times) < len(envelope):
        return  # that is a fault of structure
    if times and (times[0] < 0.0 or any(a >= b for a, b in pairwise(times))):
        yield make_fault(
            path, envelope, "its times do not increase", "start at 0 or later, each point later than the one before"
        )
