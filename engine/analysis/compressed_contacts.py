"""Contacts that are compressed when a scene begins: they push bodies apart at once, which a patch may not mean."""

from engine.assembly.layout import Layout
from engine.kernel.data.state import State


def find_compressed_contacts(layout: Layout, state: State) -> dict[int, tuple[float, float]]:
    """Find the contacts of a scene, by their numbers, that begin compressed: by how much at most, m, and with which
    energy, J."""
    found: dict[int, tuple[float, float]] = {}
    for slot, (number, _) in enumerate(layout.islands.contact_points):
        depth = float(state.compression[slot])
        if depth > 0.0:
            energy = float(state.potential_coefficient[slot]) * depth ** (float(state.exponent[slot]) + 1.0)
            largest, sum_of_energies = found.get(number, (0.0, 0.0))
            found[number] = max(largest, depth), sum_of_energies + energy
    return found
