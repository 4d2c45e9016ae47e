"""Overwrite the tables of a Model so that it becomes the Model of a scene with another value.

The two have the same arrays (`like` of engine.assembly.build.build). Where their numbers differ, and nowhere else,
those of the new Model are copied over the old ones, between two steps: so changes of islands leave each other alone.
Motion stays as it is. The change of energy is counted as supplied, so that it cannot make the sound unstable.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from engine.kernel.data.axes import Axis
from engine.kernel.data.effects import EFFECT_NAMES
from engine.kernel.data.model import Islands, Model, StepCoefficients
from engine.kernel.data.state import State

WORD_BYTES = 8
# what follows from the stiffness and damping of connections, and how its numbers lie by island
MADE_FOR_CONNECTIONS = {
    "force_per_extension": Axis.CONNECTION_PAIR,
    "force_per_move": Axis.CONNECTION_PAIR,
    "made_for_stiffness": Axis.CONNECTION,
    "made_for_damping": Axis.CONNECTION,
}
REDUCED_BY_CONNECTIONS = {"compliance": Axis.CONTACT, "compliance_low": Axis.CONTACT, "coupling": Axis.COMPLIANCE}
KEPT = ("events", "start")  # fields of a Model, and of its forces, that live sound writes to


class CannotExchange(ValueError):
    """The tables of a scene do not fit in the place of those in use."""


class Copies(NamedTuple):
    """Numbers to copy, and the addresses to copy them to."""

    table: np.ndarray  # [copies, 3]: addresses to write to and to read from, and how many words
    values: np.ndarray  # numbers to read, one after the other


class Part(NamedTuple):
    """A part of an array, in which variants of Models differ."""

    ours: np.ndarray  # of the Model in use
    variants: list[np.ndarray]  # of each variant


Span = tuple[int, int]  # the first island whose tables change, and how many do


def find_varying_parts(target: Sequence[Model], variants: Sequence[Sequence[Model]]) -> list[Part]:
    """Return the parts of arrays in which variants of Models differ.

    target: the Models in use, with their coarser ones
    Raises CannotExchange if the arrays are not alike.
    """
    parts = list[Part]()
    for ours, *models in zip(target, *variants, strict=True):
        for model in models:
            refuse_new_effects(ours, model)
        parts += _varying(ours, models, "")
    return parts


def refuse_new_effects(ours: Model, new: Model) -> None:
    """Raise CannotExchange if a Model has effects that the one in use has not: its kernel may not have them."""
    if more := [name for name, bit in EFFECT_NAMES.items() if new.effects & bit & ~ours.effects]:
        raise CannotExchange(f"it would have {' and '.join(more)}, which what sounds has not; stop and start again")


def copy_parts(target: Sequence[Model], state: State, after: Sequence[Model], parts: list[Part], span: Span) -> Copies:
    """Return the copies that give parts of arrays the numbers of their last variants, with the numbers that follow from
    them.

    target, after: the Models in use, and those with the numbers of the last variants; state: that in use
    span:          the islands whose tables change
    """
    pairs = [(part.ours, part.variants[-1]) for part in parts]
    if pairs:
        for ours, new in zip(target, after, strict=True):
            pairs += _factors(ours, new, ours.islands, span)
        if state.refinement is not None:
            pairs.append((state.refinement.margin_valid, np.zeros_like(state.refinement.margin_valid)))
    return collect_copies(pairs)


def make_alternatives(
    target: Sequence[Model], state: State, variants: Sequence[Sequence[Model]], span: Span
) -> list[Copies]:
    """Return for each of some variants of Models the copies that turn Models with the numbers of any of them into it.

    target, state, span: as of copy_parts
    Raises CannotExchange if the arrays are not alike.
    """
    parts = find_varying_parts(target, variants)
    return [
        copy_parts(target, state, models, [Part(part.ours, part.variants[n : n + 1]) for part in parts], span)
        for n, models in enumerate(variants)
    ]


def collect_copies(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> Copies:
    """Return the copies for pairs of contiguous arrays, to write to and to read from, all of 8 bytes a number."""
    values = np.concatenate([new.view(np.int64) for _, new in pairs]) if pairs else np.zeros(0, np.int64)
    begins = np.cumsum([0, *(new.size for _, new in pairs)])
    rows = [
        (ours.ctypes.data, values.ctypes.data + WORD_BYTES * int(begin), new.size)
        for (ours, new), begin in zip(pairs, begins, strict=False)
    ]
    return Copies(np.array(rows, np.int64).reshape(-1, 3), values)


def _varying(ours: Any, variants: Sequence[Any], name: str) -> Iterator[Part]:
    """Yield the parts of arrays in which variants of a value differ."""
    first, *others = variants
    is_array = isinstance(first, np.ndarray)
    if any(type(one) is not type(first) or (is_array and one.shape != first.shape) for one in others):
        raise CannotExchange(
            f"its {name.replace('_', ' ')} would have another structure than what sounds; stop and start again"
        )
    if is_array:
        if first.dtype.itemsize != WORD_BYTES:
            if not all(np.array_equal(first, one) for one in others):
                raise CannotExchange(
                    f"its {name.replace('_', ' ')} would be arranged differently; stop and start again"
                )
            return
        different = np.flatnonzero(np.any([first != one for one in others], axis=0))
        if different.size:
            flat = [np.ascontiguousarray(one).reshape(-1) for one in variants]
            for run in np.split(different, np.flatnonzero(np.diff(different) > 1) + 1):
                part = slice(int(run[0]), int(run[-1]) + 1)
                yield Part(ours.reshape(-1)[part], [one[part] for one in flat])
    elif hasattr(first, "_fields"):
        for field, mine, *values in zip(first._fields, ours, *variants, strict=True):
            if field not in KEPT:
                yield from _varying(mine, values, field)


def _factors(ours: Any, new: Any, islands: Islands, span: Span) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the numbers of some islands that the audio thread computes again where a connection's stiffness or damping
    changes, in pairs: to write to, and to read from. Those of `new` are for what the patch says; where the State has
    other values, the next step computes them again."""
    if isinstance(ours, StepCoefficients):
        if ours.connection.compliance.size:
            yield from _segments(ours.connection, new.connection, MADE_FOR_CONNECTIONS, islands, span)
            yield from _segments(ours.contact, new.contact, REDUCED_BY_CONNECTIONS, islands, span)
    elif hasattr(ours, "_fields"):
        for mine, now in zip(ours, new, strict=True):
            yield from _factors(mine, now, islands, span)


def _segments(
    ours: Any, new: Any, axes: Mapping[str, Axis], islands: Islands, span: Span
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the numbers of some islands in arrays of a record, in pairs: to write to, and to read from."""
    for name, axis in axes.items():
        mine, now = getattr(ours, name), getattr(new, name)
        if mine.size:
            begins = getattr(islands, axis)
            part = slice(int(begins[span[0]]), int(begins[sum(span)]))
            size = mine.shape[-1]
            for row, other in zip(mine.reshape(-1, size), now.reshape(-1, size), strict=True):
                yield row[part], np.ascontiguousarray(other[part])
