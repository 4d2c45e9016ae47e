"""Keys that are down, and what the pedals keep of them."""

from collections.abc import Hashable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
PEDAL_STEPS = 8  # to which half pedal is rounded
SOSTENUTO_HALF = 0.5


class HeldKeys(Generic[K]):
    """The keys that are down, those that the sostenuto pedal keeps, and how far each pedal is down, 0 to 1."""

    def __init__(self) -> None:
        self.down: set[K] = set()
        self.kept: set[K] = set()
        self.pedals = {"sustain": 0.0, "soft": 0.0, "sostenuto": 0.0}

    def move_pedal(self, name: str, value: float) -> bool:
        """Move a pedal. The sostenuto pedal keeps the keys that are down as it goes down. Return True if dampers may
        move."""
        before, self.pedals[name] = self.pedals[name], value
        if name == "sustain":
            return damper_share(before) != damper_share(value)
        if name != "sostenuto" or (before < SOSTENUTO_HALF) == (value < SOSTENUTO_HALF):
            return False
        self.kept = set(self.down) if value >= SOSTENUTO_HALF else set()
        return True

    def damper_share(self, key: K) -> float:
        """Return the share of its force with which the damper of a key is on its strings; 0 if it is lifted."""
        return 0.0 if key in self.down or key in self.kept else damper_share(self.pedals["sustain"])


def damper_share(sustain: float) -> float:
    """Return the share of their force that a sustain pedal leaves to the dampers."""
    return round((1.0 - sustain) * PEDAL_STEPS) / PEDAL_STEPS
