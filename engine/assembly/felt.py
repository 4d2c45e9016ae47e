"""Contacts of felt with memory (engine.kernel.contact.felt_law)."""

import numpy as np

from engine.assembly.layout import Layout
from engine.kernel.data.felt_numbers import FeltNumber
from engine.patch.tables import Contact


def add_felt_numbers(layout: Layout, samplerate: float, numbers: np.ndarray) -> None:
    """Write State.law_numbers of felt with memory at time 0, when nothing has pressed it yet."""
    for slot, (k, _) in enumerate(layout.islands.contact_points):
        table = layout.touching[k]
        if isinstance(table, Contact) and table.relaxation is not None:
            numbers[slot, FeltNumber.SHARE] = table.relaxation.share
            numbers[slot, FeltNumber.RATE] = 1.0 / (table.exponent * table.relaxation.time * samplerate)


def has_felt(numbers: np.ndarray) -> bool:
    """True if a contact is felt with memory. numbers: State.law_numbers"""
    return bool(np.any(numbers[:, FeltNumber.SHARE] > 0.0))
