"""Keys that are down, and what the pedals keep of them."""

from collections.abc import Hashable, Iterable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
ALL = 0  # instead of a channel: a pedal of all channels; a key that follows the latest move of any
PEDAL_NAMES = "sustain", "soft", "sostenuto"
PEDAL_STEPS = 8  # to which half pedal is rounded
SOSTENUTO_HALF = 0.5


class HeldKeys(Generic[K]):
    """The keys that are down, those that the sostenuto pedal keeps, and how far each pedal is down, 0 to 1.

    A key follows the pedals of the channels that played it last; one that was never played, those of all.

    together: all keys follow the latest move of a pedal, whatever its channel
    """

    def __init__(self) -> None:
        self.down: set[K] = set()
        self.kept: set[K] = set()
        self.together = False
        self._channels: dict[K, set[int]] = {}  # that a key follows
        self._pedals: dict[str, dict[int, float]] = {name: {ALL: 0.0} for name in PEDAL_NAMES}  # by channel
        self._latest = dict.fromkeys(PEDAL_NAMES, 0.0)

    def press(self, key: K, channels: Iterable[int] = (ALL,)) -> None:
        """Press a key, which follows the pedals of these channels; one that is down follows those before, too."""
        self._channels[key] = set(channels) | (self._channels.get(key, set()) if key in self.down else set())
        self.down.add(key)

    def move_pedal(self, name: str, value: float, channel: int = ALL) -> bool:
        """Move a pedal. The sostenuto pedal keeps the keys that are down as it goes down. Return True if dampers may
        move."""
        pedals = self._pedals[name]
        before = self._latest[name] if self.together or channel == ALL else pedals.get(channel, pedals[ALL])
        self._latest[name] = value
        if channel == ALL:
            pedals.clear()
        pedals[channel] = value
        if name == "sustain":
            return damper_share(before) != damper_share(value)
        if name != "sostenuto" or (before < SOSTENUTO_HALF) == (value < SOSTENUTO_HALF):
            return False
        followers = {key for key in self.down | self.kept if self.follows(key, channel)}
        self.kept = self.kept - followers | (followers & self.down if value >= SOSTENUTO_HALF else set())
        return True

    def follows(self, key: K, channel: int) -> bool:
        """True if a move of a pedal on a channel concerns a key."""
        channels = self._channels.get(key)
        return self.together or channel == ALL or channels is None or channel in channels or ALL in channels

    def pedal(self, name: str, key: K) -> float:
        """Return how far a pedal is down for a key."""
        pedals, channels = self._pedals[name], self._channels.get(key)
        if self.together:
            return self._latest[name]
        if channels is None:
            return max(pedals.values())
        return max(self._latest[name] if one == ALL else pedals.get(one, pedals[ALL]) for one in channels)

    def pedals_of(self, key: K) -> dict[str, float]:
        """Return how far each pedal is down for a key."""
        return {name: self.pedal(name, key) for name in PEDAL_NAMES}

    def pedal_moves(self) -> list[tuple[str, float, int]]:
        """Return the moves, each with its channel, that bring pedals that are up to where these are."""
        return [(name, value, one) for name, all_of in self._pedals.items() for one, value in all_of.items() if value]

    def keeps(self, key: K) -> bool:
        """True if the dampers of a key are lifted, whatever the sustain pedal does."""
        return key in self.down or key in self.kept

    def damper_share(self, key: K) -> float:
        """Return the share of its force with which the damper of a key is on its strings; 0 if it is lifted."""
        return 0.0 if self.keeps(key) else damper_share(self.pedal("sustain", key))


def damper_share(sustain: float) -> float:
    """Return the share of their force that a sustain pedal leaves to the dampers."""
    return round((1.0 - sustain) * PEDAL_STEPS) / PEDAL_STEPS
