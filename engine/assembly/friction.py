"""Points of friction, which lie among those of contacts (engine.kernel.interactions.friction)."""

import numpy as np

from engine.assembly.layout import Layout
from engine.kernel.data import model
from engine.kernel.data.enums import Sliding
from engine.patch.friction import CHANGED_KEYS, Friction


def friction_points(layout: Layout) -> dict[int, Friction]:
    """Return the table of each point of friction, by its number among the contacts of all islands."""
    tables = [(slot, layout.touching[k]) for slot, (k, _) in enumerate(layout.islands.contact_points)]
    return {slot: table for slot, table in tables if isinstance(table, Friction)}


def friction(layout: Layout) -> model.Friction | None:
    """Return the points of friction of a layout; None without any."""
    points, begins = friction_points(layout), layout.islands.contact_begins
    if not points:
        return None
    island_of = np.repeat(np.arange(begins.size - 1), np.diff(begins))
    pressed_by, is_present = np.full(begins[-1], -1), np.zeros(begins.size - 1, np.int64)
    before: dict[int, int] = {}  # points of a table, so far
    for slot, table in points.items():
        is_present[island_of[slot]] = 1
        number = before[id(table)] = before.get(id(table), -1) + 1
        if table.contact is not None:
            pressing = _slots_of_contact(layout, table.contact)
            pressed_by[slot] = pressing[min(number, len(pressing) - 1)] - begins[island_of[slot]]
    return model.Friction(pressed_by, is_present)


def _slots_of_contact(layout: Layout, name: str) -> list[int]:
    """Return the places of the points of a contact."""
    contacts = layout.scene.contact
    points = enumerate(layout.islands.contact_points)
    return [slot for slot, (k, _) in points if k < len(contacts) and contacts[k].name == name]


def initial_friction(layout: Layout) -> np.ndarray | None:
    """Return the numbers of all points at time 0 [contacts, Sliding]; None without friction."""
    points = friction_points(layout)
    if not points:
        return None
    numbers = np.zeros((len(layout.islands.contact_points), len(Sliding)))
    for slot, table in points.items():
        numbers[slot, : len(CHANGED_KEYS)] = [getattr(table, key) or 0.0 for key in CHANGED_KEYS]
        numbers[slot, Sliding.PRESS] = table.force or 0.0
    return numbers
