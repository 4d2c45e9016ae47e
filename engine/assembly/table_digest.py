"""A digest of the tables of a scene: 16 hexadecimal digits that differ where any number of them does. Logs, statistics
and bug reports hold it, so that a sound that differs between two machines can be traced to its tables or to its kernel.
"""

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from engine.assembly.build import build
from engine.files import SHIPPED_PATCHES
from engine.kernel.data.enums import UNUSED_SLOT
from engine.kernel.data.model import Events, Model
from engine.kernel.data.state import Scratch, State
from engine.patch.scene import Scene

DIGITS = 16
SHIPPED_DIGESTS = "table_digests.txt"  # among the shipped patches: a name and a digest on each line
NOTHING = np.zeros(0)
SAMPLERATE = 44_100  # Hz, of renderings that ask for no other


def digest_tables(model: Model, state: State) -> str:
    """Return the digest of the names, types, shapes and numbers of a Model and of its State at time 0 (SHA-256).

    -0 is the same as 0, and all NaN are the same. Memory whose size changes no sound does not count: free slots for
    events, partitions, and what each of these has.
    """
    names: list[str] = []
    numbers: dict[str, list[np.ndarray]] = {}  # by their type: to join them first is four times as fast
    for name, record in (("model", _without_free_slots(model)), ("state", _without_free_memory(state))):
        for path, array in _named_arrays(record, name):
            kind = array.dtype.str[1:]  # without the order of its bytes
            names.append(f"{path} {kind} {array.shape}\n")
            numbers.setdefault(kind, []).append(array.ravel())
    digest = hashlib.sha256("".join(names).encode())
    for _, arrays in sorted(numbers.items()):
        joined = np.concatenate(arrays)
        if joined.dtype.kind == "f":
            joined += 0.0  # turns -0 into 0
            joined[np.isnan(joined)] = np.nan
        digest.update(joined.astype(joined.dtype.newbyteorder("<"), copy=False).data)
    return digest.hexdigest()[:DIGITS]


def digest_scene(scene: Scene) -> str:
    """Return the digest of a scene as a rendering builds it that asks for nothing else. Raises BuildError."""
    built = build(scene, SAMPLERATE * scene.accuracy.oversample, scene.accuracy, scene.seconds)
    return digest_tables(built.model, built.state)


def read_shipped_digests() -> dict[str, str]:
    """Read the digests of the shipped patches, by name, as they were when the engine was published. Raises OSError."""
    text = (SHIPPED_PATCHES / SHIPPED_DIGESTS).read_text("utf-8")
    return dict(line.split() for line in text.splitlines())


def _without_free_slots(model: Model) -> Model:
    """Return a Model without free slots for events, and without partitions."""
    islands, events = model.islands, model.events
    used = events.start != UNUSED_SLOT
    begins = np.concatenate([[0], np.cumsum(used)])[islands.event]  # of the events that are used
    events = Events(*(array[used] for array in events))
    return model._replace(islands=islands._replace(event=begins, partition=NOTHING), events=events)


def _without_free_memory(state: State) -> State:
    """Return a State without what partitions and slots for events have."""
    flight = state.flight._replace(parts=NOTHING)
    return state._replace(
        flight=flight, frame=NOTHING, glide_start=NOTHING, scratch=Scratch(*[NOTHING] * len(Scratch._fields))
    )


def _named_arrays(record: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays and numbers of a record, and of the records in it, with their names."""
    for field, value in zip(record._fields, record, strict=True):
        path = f"{name}.{field}"
        if hasattr(value, "_fields"):
            yield from _named_arrays(value, path)
        elif value is not None:
            yield path, np.asarray(value)
