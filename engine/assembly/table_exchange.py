"""Overwrite the tables of a Model so that it becomes the Model of a scene with another value.

The two have the same arrays (`like` of engine.assembly.build.build). Where their numbers differ, those of the new Model
are copied over the old ones, between two steps. Motion stays as it is. The change of energy is counted as supplied, so
that it cannot make the sound unstable.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from engine.kernel.data.model import Model, StepCoefficients
from engine.kernel.data.state import State

WORD_BYTES = 8
MADE_FOR_CONNECTIONS = ("force_per_extension", "force_per_move", "made_for_stiffness", "made_for_damping")
REDUCED_BY_CONNECTIONS = ("compliance", "compliance_low", "coupling")
KEPT = ("events", "start", "scale")  # fields of a Model, and of its forces, that live sound writes to


class CannotExchange(ValueError):
    """The tables of a scene do not fit in the place of those in use."""


class Copies(NamedTuple):
    """Numbers to copy, and the addresses to copy them to."""

    table: np.ndarray  # [copies, 3]: addresses to write to and to read from, and how many words
    values: np.ndarray  # numbers to read, one after the other


def make_copies(target: Sequence[Model], state: State, before: Sequence[Model], after: Sequence[Model]) -> Copies:
    """Return the copies that turn Models with the numbers of `before` into those of `after`.

    target: the Models in use, with their coarser ones; state: their State
    Raises CannotExchange if the arrays are not alike.
    """
    varying = _varying_parts(target, [before, after])
    return _copies_of(target, state, after, [(ours, variants[-1]) for ours, variants in varying])


def make_alternatives(target: Sequence[Model], state: State, variants: Sequence[Sequence[Model]]) -> list[Copies]:
    """Return for each of some variants of Models the copies that turn Models with the numbers of any of them into it.

    target, state: as of make_copies
    Raises CannotExchange if the arrays are not alike.
    """
    varying = _varying_parts(target, variants)
    return [
        _copies_of(target, state, models, [(ours, parts[n]) for ours, parts in varying])
        for n, models in enumerate(variants)
    ]


def _copies_of(
    target: Sequence[Model], state: State, after: Sequence[Model], pairs: list[tuple[np.ndarray, np.ndarray]]
) -> Copies:
    """Return the copies for the parts that differ, with those of numbers that follow from them."""
    if pairs:
        pairs += [pair for ours, new in zip(target, after, strict=True) for pair in _factors(ours, new)]
        if state.refinement is not None:
            pairs.append((state.refinement.margin_valid, np.zeros_like(state.refinement.margin_valid)))
    return collect_copies(pairs)


def collect_copies(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> Copies:
    """Return the copies for pairs of contiguous arrays, to write to and to read from, all of 8 bytes a number."""
    values = np.concatenate([new.view(np.int64) for _, new in pairs]) if pairs else np.zeros(0, np.int64)
    begins = np.cumsum([0, *(new.size for _, new in pairs)])
    rows = [
        (ours.ctypes.data, values.ctypes.data + WORD_BYTES * int(begin), new.size)
        for (ours, new), begin in zip(pairs, begins, strict=False)
    ]
    return Copies(np.array(rows, np.int64).reshape(-1, 3), values)


def _varying_parts(
    target: Sequence[Model], variants: Sequence[Sequence[Model]]
) -> list[tuple[np.ndarray, list[np.ndarray]]]:
    """Return the parts of arrays in which variants of Models differ: to write to, and to read from, of each variant."""
    if target[0].step.kick.dtype != np.float64:
        raise CannotExchange('single precision has no tables to exchange; precision = "float64"')
    parts: list[tuple[np.ndarray, list[np.ndarray]]] = []
    for ours, *models in zip(target, *variants, strict=True):
        parts += _varying(ours, models, "")
    return parts


def _varying(ours: Any, variants: Sequence[Any], name: str) -> Iterator[tuple[np.ndarray, list[np.ndarray]]]:
    """Yield the parts of arrays in which variants of a value differ: to write to, and to read from, of each variant."""
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
            part = slice(int(different[0]), int(different[-1]) + 1)
            yield ours.reshape(-1)[part], [np.ascontiguousarray(one).reshape(-1)[part] for one in variants]
    elif hasattr(first, "_fields"):
        for field, mine, *values in zip(first._fields, ours, *variants, strict=True):
            if field not in KEPT:
                yield from _varying(mine, values, field)


def _factors(ours: Any, new: Any) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield all numbers that the audio thread computes again where a connection's stiffness or damping changes, in
    pairs: to write to, and to read from. Those of `new` are for what the patch says; where the State has other values,
    the next step computes them again."""
    if isinstance(ours, StepCoefficients):
        for record, names in ((ours.connection, MADE_FOR_CONNECTIONS), (ours.contact, REDUCED_BY_CONNECTIONS)):
            target = new.connection if record is ours.connection else new.contact
            for name in names if record is not None and ours.connection is not None else ():
                mine, now = getattr(record, name), getattr(target, name)
                if mine is not None:
                    yield mine.reshape(-1), np.ascontiguousarray(now).reshape(-1)
    elif hasattr(ours, "_fields"):
        for mine, now in zip(ours, new, strict=True):
            yield from _factors(mine, now)
