"""The effects that a scene may have, and which of them are compiled."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from engine.kernel.data.model import Model
from engine.offline.statistics_base import Statistics

# name, and what holds it: None where the effect is left out
EFFECTS: dict[str, Callable[[Model], Any]] = {
    "loss": lambda model: model.step.loss,
    "loss within the step": lambda model: model.step.drag,
    "restoring force": lambda model: model.omega_squared,
    "gravity": lambda model: model.weight,
    "external force": lambda model: model.force,
    "one-way drive": lambda model: model.drive,
    "contact": lambda model: model.contact,
    "contact between bodies": lambda model: model.contact and model.contact.other_rows,
    "contact loss": lambda model: _at_contacts(model, "loss_rate"),
    "coupled contacts": lambda model: _at_contacts(model, "coupling"),
    "connections": lambda model: model.connection,
    "stretching": lambda model: model.tension,
    "refinement": lambda model: model.refinement,
    "friction": lambda model: model.contact and model.contact.friction,
    "events": lambda model: model.events,
}


@dataclass(frozen=True)
class EffectStatistics(Statistics):
    """The effects that are compiled, and those that are left out."""

    compiled: list[str]
    left_out: list[str]


def effects_of(model: Model) -> EffectStatistics:
    """Tell which effects a model has."""
    compiled = [name for name, find in EFFECTS.items() if find(model) is not None]
    return EffectStatistics(compiled, [name for name in EFFECTS if name not in compiled])


def _at_contacts(model: Model, name: str) -> Any:
    """Return an entry of the step at contacts; None without contacts."""
    return None if model.step.contact is None else getattr(model.step.contact, name)
