"""The effects that a scene has, and those that it lacks."""

from dataclasses import dataclass

from engine.kernel.data.effects import EFFECT_NAMES
from engine.kernel.data.model import Model
from engine.offline.statistics_base import Statistics

STAGES = "refinement"  # an effect that no bit stands for


@dataclass(frozen=True)
class EffectStatistics(Statistics):
    """The effects that a special kernel of a scene has compiled, and those that it leaves out."""

    compiled: list[str]
    left_out: list[str]


def effects_of(model: Model) -> EffectStatistics:
    """Tell which effects a model has."""
    has = {name: bool(model.effects & bit) for name, bit in EFFECT_NAMES.items()}
    has[STAGES] = model.refinement is not None
    return EffectStatistics([name for name in has if has[name]], [name for name in has if not has[name]])
