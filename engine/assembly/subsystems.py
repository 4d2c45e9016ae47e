"""Islands: groups of bodies that contacts and connections join, directly or through others. Islands are not coupled to
each other, so each is computed alone."""

from collections.abc import Iterable

import numpy as np

from engine.arithmetic.elementary import square

MAX_PARTITIONS = 8  # the largest number of cores that can share the work
MIN_COST_FOR_THREADS = 200.0  # ns a sample: below, waking a thread costs more than it saves
COST_PER_ISLAND = 15.0  # ns a sample, besides its modes and contacts


def connected_components(count: int, pairs: Iterable[tuple[int, int]]) -> list[int]:
    """Return the component of each of `count` items that pairs join, numbered from 0 in the order of their first
    items."""
    root = list(range(count))

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    for first, second in pairs:
        a, b = find(first), find(second)
        root[max(a, b)] = min(a, b)
    number = {first: n for n, first in enumerate(sorted({find(i) for i in range(count)}))}
    return [number[find(i)] for i in range(count)]


def estimate_cost(modes: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """Estimate the cost of islands in contact from their numbers of modes and contacts, ns a sample [islands]."""
    return np.asarray(COST_PER_ISLAND + modes * (1 + contacts / 4) + square(contacts))


def partition_islands(cost: np.ndarray) -> np.ndarray:
    """Cut the islands into partitions of about equal cost, and return where each begins [partitions + 1]. There is one
    partition if the cost is small."""
    total = np.cumsum(cost)
    if total.size < 2 or total[-1] < MIN_COST_FOR_THREADS:
        return np.array([0, total.size])
    partitions = min(MAX_PARTITIONS, total.size)
    cuts = np.searchsorted(total, np.arange(1, partitions) * total[-1] / partitions) + 1
    return np.unique(np.concatenate([[0], cuts, [total.size]]))
