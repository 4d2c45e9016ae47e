"""A scene as bytes in two parts: numbers that stay, which all instances of a plug-in share, and what each has for
itself. Addresses in the second name places in either."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from engine.export.exchange_bytes import COPIES, COPY_NUMBERS, VALUES
from engine.export.scene_bytes import ALIGNMENT, MARGIN, NUMBER_BYTES, SceneBytes
from engine.kernel.data.model import Events

CHANGED = {  # arrays of a model that kernels make anew when a stiffness or a damping changes
    *("force_per_extension", "force_per_move", "made_for_stiffness", "made_for_damping"),
    *("compliance", "compliance_low", "coupling"),
}
IS_SHARED = 1 << 62  # in a place: it is one of the shared part


class SharedBytes:
    """The two parts of a scene that was laid out at address 0.

    shared, private: their bytes
    pointers: places in `private` of addresses, sorted; each is a place in `private`, or in `shared` if it has the bit
              IS_SHARED
    """

    def __init__(self, laid_out: SceneBytes) -> None:
        self._moved = list(_moved_spans(laid_out))
        self._begins = [span.begin for span in self._moved]
        size = sum(span.is_shared * (span.end - span.begin) for span in self._moved)
        self.shared, self.private = bytearray(size), bytearray(len(laid_out.content) - size)
        for span in self._moved:
            part = self.shared if span.is_shared else self.private
            part[span.to : span.to + span.end - span.begin] = laid_out.content[span.begin : span.end]
        self.pointers = list[int]()
        for place in sorted(set(laid_out.pointers)):
            target = int.from_bytes(laid_out.content[place : place + NUMBER_BYTES], "little", signed=True)
            at, is_shared = self._find(place)
            assert not is_shared  # an address is never among the numbers that stay
            self.private[at : at + NUMBER_BYTES] = self.place(target).to_bytes(NUMBER_BYTES, "little")
            self.pointers.append(at)

    def place(self, old: int) -> int:
        """Return where a place of the scene is now, with IS_SHARED if it is in the shared part."""
        at, is_shared = self._find(old)
        return at | IS_SHARED * is_shared

    def private_place(self, old: int) -> int:
        """Return where a place of the scene is in the part of each instance."""
        at, is_shared = self._find(old)
        assert not is_shared
        return at

    def _find(self, old: int) -> tuple[int, bool]:
        span = self._moved[bisect_right(self._begins, old) - 1]
        return old - span.begin + span.to, span.is_shared


class _Span(NamedTuple):
    """Bytes of a scene, and where they go."""

    begin: int
    end: int
    to: int
    is_shared: bool


def _moved_spans(laid_out: SceneBytes) -> Iterable[_Span]:
    """Yield all bytes of a scene as spans, in their order."""
    written, begin, private, shared = sorted(_written_places(laid_out)), 0, 0, 0
    for first, size in sorted(_constant_arrays(laid_out)):
        end = min(len(laid_out.content), -(-(first + size + MARGIN) // ALIGNMENT) * ALIGNMENT)
        at = bisect_left(written, first)
        if first < begin or (at < len(written) and written[at] < end):
            continue
        if begin < first:
            yield _Span(begin, first, private, False)
            private += first - begin
        yield _Span(first, end, shared, True)
        shared += end - first
        begin = end
    yield _Span(begin, len(laid_out.content), private, False)


def _constant_arrays(laid_out: SceneBytes) -> Iterable[tuple[int, int]]:
    """Yield place and size of each array that no kernel writes to: those of models but for what events change, and the
    numbers of exchanges of tables."""
    for name, value in laid_out.kept_values():
        if name.startswith("model "):
            yield from laid_out.places_of_arrays(value, but=tuple(_changed_arrays(value)))
        elif name.startswith(VALUES):
            yield from laid_out.places_of_arrays(value)


def _changed_arrays(record: Any) -> Iterator[np.ndarray]:
    """Yield the arrays of a model that kernels write to: events as they come, and CHANGED."""
    if not isinstance(record, tuple):
        return
    for name, value in zip(getattr(record, "_fields", [""] * len(record)), record, strict=True):
        if isinstance(value, np.ndarray) and (name in CHANGED or isinstance(record, Events)):
            yield value
        yield from _changed_arrays(value)


def _written_places(laid_out: SceneBytes) -> Iterable[int]:
    """Yield a place of each array that an exchange of tables writes to."""
    for name, table in laid_out.kept_values():
        if name.startswith(COPIES):
            begin = laid_out.place_of(table)
            rows = np.frombuffer(laid_out.content, np.int64, table.size, begin).reshape(-1, COPY_NUMBERS)
            yield from rows[:, 0].tolist()
