"""A general model, which has every effect: absent ones become neutral, so that one kernel runs any scene.

A kernel is compiled for the types of a model, and what is None in it is not compiled. Here each absent effect is
replaced by arrays of neutral numbers (engine.kernel.data.axes.Items): a loss that takes nothing, no contacts, no
events. The sound is the same, bit for bit. Only refinement stays as it is: scenes with it and without it have different
kernels.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.array_memory import array_shape
from engine.assembly.initial_state import allocate_scratch, item_counts
from engine.kernel.data.axes import Axis, Items, fields_of
from engine.kernel.data.laws import NO_NUMBERS, Power
from engine.kernel.data.model import Model, Refinement
from engine.kernel.data.state import RefinementState, State

KEPT_ABSENT = Refinement, RefinementState
NUMBERS = {"tolerance": 0.0, "max_rounds": 0}  # of an absent Contact
NUMBERS |= {"finest": 0, "limit": 0.0}  # and of absent AdaptiveSteps


class Filling(NamedTuple):
    """Sizes of the neutral arrays that replace absent ones."""

    counts: Mapping[Axis, int]
    stages: int  # rows in front of each array; 0: none
    row_axis: Axis | None  # axis of rows of mode shapes


def generalise(model: Model, state: State) -> tuple[Model, State]:
    """Return a Model and a State for the general kernel, which give the same samples. They keep the given arrays, and
    have neutral ones where there were none."""
    counts = {Axis.SHAPE: 0, Axis.SHARED: 0, **item_counts(model)}
    filling = Filling(counts, 0, None)
    contacts = int(np.diff(model.islands.contact).max(initial=1))
    if state.scratch is None:
        state = state._replace(scratch=allocate_scratch(counts[Axis.PARTITION], max(1, contacts)))
    return fill_record(Model, model, filling), fill_record(State, state, filling)


def fill_record(record: Any, value: Any, filling: Filling) -> Any:
    """Return a record like `value` with neutral values in place of absent ones; all are neutral if `value` is None.

    record: its class
    """
    values: dict[str, Any] = {}
    for field in fields_of(record):
        given = getattr(value, field.name, None)
        if field.record in KEPT_ABSENT and given is None:
            values[field.name] = None
        elif field.name == "law":
            values[field.name] = Power(NO_NUMBERS, NO_NUMBERS)
        elif field.record is not None:
            inner = filling._replace(row_axis=field.row_axis or filling.row_axis)
            if field.name == "stages":
                inner = inner._replace(stages=len(value.stages.kick))
            values[field.name] = fill_record(field.record, given, inner)
        elif given is None and field.items is not None:
            values[field.name] = neutral_array(field.items, filling)
        else:
            values[field.name] = NUMBERS[field.name] if given is None else given
    return record(**values)


def neutral_array(items: Items, filling: Filling) -> np.ndarray:
    """Return an array of items that do nothing."""
    if items.axis is Axis.ROW and filling.row_axis is not None:
        items = replace(items, axis=filling.row_axis)
    stages = (filling.stages,) if filling.stages else ()
    return np.full((*stages, *array_shape(items, filling.counts)), items.neutral, items.dtype)
