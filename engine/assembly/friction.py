"""Points of friction, which lie among those of contacts (engine.kernel.contact.friction_points)."""

from itertools import pairwise

import numpy as np

from engine.arithmetic.elementary import square
from engine.assembly.array_memory import ABSENT
from engine.assembly.layout import Layout
from engine.faults import BuildError, Fault
from engine.kernel.data import model
from engine.kernel.data.enums import LAW_NUMBERS, Sliding
from engine.patch.accuracy import Accuracy
from engine.patch.friction import DAMPING_TIME, Friction
from engine.patch.live_parameters import GLIDED_KEYS
from engine.patch.scene import Scene

MIXING = 1e-3  # of the compliance of two points: less is no motion, as at an angle of 1.571 between them


def check_order(scene: Scene, accuracy: Accuracy) -> None:
    """Raise BuildError if steps are to go back in time, in which a law that takes energy would give it."""
    if accuracy.order <= 2:
        return
    for section in ("friction", "contact"):
        for n, table in enumerate(getattr(scene, section)):
            if not table.has_power_law:
                message = f"{section} has order 2, not {accuracy.order}: some steps of that order go back in time"
                raise BuildError(
                    Fault(f"{section}[{n}]", f"{message}, in which it would give energy; give substeps or a max_error")
                )


def friction_points(layout: Layout) -> dict[int, Friction]:
    """Return the table of each point of friction, by its number among the contacts of all islands."""
    tables = [(slot, layout.touching[k]) for slot, (k, _) in enumerate(layout.islands.contact_points)]
    return {slot: table for slot, table in tables if isinstance(table, Friction)}


def friction(layout: Layout, coupling: np.ndarray) -> model.Friction:
    """Return the points of friction of a layout; ABSENT without any. coupling: B of each island, m/N, or ABSENT"""
    points, begins = friction_points(layout), layout.islands.contact_begins
    if not points:
        return ABSENT
    island_of = np.repeat(np.arange(begins.size - 1), np.diff(begins))
    pressed_by, is_present = np.full(begins[-1], -1), np.zeros(begins.size - 1, np.int64)
    before: dict[int, int] = {}  # points of a table, so far
    for slot, table in points.items():
        is_present[island_of[slot]] = 1
        number = before[id(table)] = before.get(id(table), -1) + 1
        if table.contact is not None:
            pressing = _slots_of_contact(layout, table.contact)
            pressed_by[slot] = pressing[min(number, len(pressing) - 1)] - begins[island_of[slot]]
    blocks = zip(pairwise(begins), _blocks(begins, coupling), strict=True)
    is_apart = [_is_apart(pressed_by[a:b], block) for (a, b), block in blocks]
    return model.Friction(pressed_by, is_present, np.array(is_apart, np.int64))


def _blocks(begins: np.ndarray, coupling: np.ndarray) -> list[np.ndarray]:
    """Return B of each island [contacts, contacts], m/N; zeros where no island has several contacts."""
    counts = np.diff(begins)
    if coupling is ABSENT:
        return [np.zeros((count, count)) for count in counts]
    parts = np.split(coupling, np.cumsum(square(counts))[:-1])
    return [part.reshape(count, count) for part, count in zip(parts, counts, strict=True)]


def _is_apart(pressed_by: np.ndarray, compliance: np.ndarray) -> bool:
    """True if contacts press points of an island, and the friction there moves no other point. compliance: B, m/N"""
    pressed, itself = pressed_by >= 0, np.diag(compliance)
    mixed = square(compliance) > square(MIXING) * np.outer(itself, itself)
    return bool(pressed.any()) and not mixed[np.ix_(pressed, ~pressed)].any()


def _slots_of_contact(layout: Layout, name: str) -> list[int]:
    """Return the places of the points of a contact."""
    contacts = layout.scene.contact
    points = enumerate(layout.islands.contact_points)
    return [slot for slot, (k, _) in points if k < len(contacts) and contacts[k].name == name]


def initial_law_numbers(layout: Layout) -> np.ndarray:
    """Return State.law_numbers at time 0: those of points of friction [contacts, LAW_NUMBERS]."""
    numbers = np.zeros((len(layout.islands.contact_points), LAW_NUMBERS))
    for slot, table in friction_points(layout).items():
        values = [getattr(table, key) or 0.0 for key in GLIDED_KEYS["friction"]]
        numbers[slot, : len(values)] = values
        numbers[slot, Sliding.PRESS] = table.force or 0.0
        numbers[slot, Sliding.DAMPING_TIME] = damping_time(table)
        numbers[slot, Sliding.VISCOUS] = table.viscous
        numbers[slot, Sliding.IS_EXPONENTIAL] = table.curve == "exponential"
    return numbers


def damping_time(table: Friction) -> float:
    """Return the damping of the bristle of a point over its stiffness, s."""
    return DAMPING_TIME if table.bristle_damping is None else table.bristle_damping / table.bristle
