"""Arrays that do nothing in place of what a scene lacks (engine.kernel.data.axes.Items): a loss that takes nothing, no
contacts, no events. So every Model and every State has all parts but those of stages, and one kernel runs any scene.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.array_memory import array_shape
from engine.assembly.felt import has_felt
from engine.assembly.initial_state import allocate_scratch, item_counts
from engine.kernel.data import effects
from engine.kernel.data.axes import Axis, Items, fields_of
from engine.kernel.data.model import Model, Refinement
from engine.kernel.data.state import RefinementState, State

OF_STAGES = Refinement, RefinementState  # None in a scene without stages
NUMBERS = {"tolerance": 0.0, "max_rounds": 0}  # of an absent Contact
NUMBERS |= {"finest": 0, "limit": 0.0}  # and of absent AdaptiveSteps


class Filling(NamedTuple):
    """Sizes of the arrays that replace absent ones."""

    counts: Mapping[Axis, int]
    stages: int  # rows in front of each array; 0: none
    row_axis: Axis | None  # axis of rows of mode shapes


def fill_absent_parts(model: Model, state: State) -> tuple[Model, State]:
    """Return a Model and a State with the given arrays, and with such that do nothing in place of those that are None.
    The Model says which effects it has."""
    counts = {Axis.SHAPE: 0, Axis.SHARED: 0, **item_counts(model)}
    filling = Filling(counts, 0, None)
    if state.scratch is None:
        state = state._replace(scratch=allocate_scratch(counts[Axis.PARTITION], 1))
    filled: State = fill_record(State, state, filling)
    begins = model.islands.contact
    filled.connection.near.contact[:] = np.arange(begins[-1]) - np.repeat(
        begins[:-1], np.diff(begins)
    )  # all are in reach
    return fill_record(Model, model._replace(effects=find_effects(model, state)), filling), filled


def fill_stages(model: Model, stages: Refinement) -> Refinement:
    """Return stages of a Model with nothing absent."""
    filling = Filling({Axis.SHAPE: 0, Axis.SHARED: 0, **item_counts(model)}, 0, None)
    filled: Refinement = fill_record(Refinement, stages, filling)
    return filled


def find_effects(model: Any, state: State) -> int:
    """Return the bits of the effects of a Model (engine.kernel.data.effects), of which the others are None."""
    step, contact = model.step, model.contact
    parts = {
        effects.SPRINGS: model.omega_squared,
        effects.WEIGHT: model.weight,
        effects.LOSS: step.loss,
        effects.DRAG: step.drag,
        effects.CONTACTS: contact,
        effects.TWO_BODIES: contact and contact.other_rows,
        effects.SEVERAL: contact and step.contact.coupling,
        effects.CONTACT_LOSS: contact and step.contact.loss_rate,
        effects.FRICTION: contact and contact.friction,
        effects.CONNECTIONS: model.connection,
        effects.STRETCHING: model.tension,
        effects.FORCES: model.force,
        effects.DRIVE: model.drive,
        effects.EVENTS: model.events,
        effects.RELAXATION: has_felt(state.law_numbers) or None,
    }
    return sum(bit for bit, part in parts.items() if part is not None)


def fill_record(record: Any, value: Any, filling: Filling) -> Any:
    """Return a record like `value`, in which nothing is absent; all of it does nothing if `value` is None.

    record: its class
    """
    values: dict[str, Any] = {}
    for field in fields_of(record):
        given = getattr(value, field.name, None)
        if field.record in OF_STAGES and given is None:
            values[field.name] = None
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
