"""The kernel that runs a model: the general one, which has every effect and runs any scene; or, if it is chosen, a
special one, compiled for the effects of the scene and nothing else. The samples are the same, bit for bit.

The general kernel comes with the engine; where no archive fits the machine, it is compiled once. A special kernel takes
half a minute to compile for each set of effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from engine.compiler.kernel_name import KernelName, read_kernel_name
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import Kind
from engine.compiler.special_kernels import ALL
from engine.compiler.struct_handle import StructHandle, pointer_kind
from engine.kernel.data.model import Model
from engine.kernel.data.state import State


class Use(NamedTuple):
    """A kernel that is to run with a Model and a State, and the kinds of its other arguments."""

    kernel: Kernel
    others: tuple[Kind, ...]


@dataclass(frozen=True)
class Prepared:
    """Models of one kind and a state, and the name of the kernel that is to run them."""

    models: Sequence[Model]
    state: State
    name: KernelName

    @cached_property
    def kinds(self) -> tuple[Kind, Kind]:
        """The kinds of a pointer to the model, with the effects of the kernel, and of one to the state."""
        effects = self.models[0].effects if self.name is KernelName.SPECIAL else ALL
        return pointer_kind(self.models[0], effects), pointer_kind(self.state)

    def handles(self) -> tuple[list[StructHandle], StructHandle]:
        """Return the models and the state in the layout of compiled code."""
        model_kind, state_kind = self.kinds
        return [StructHandle(model, model_kind) for model in self.models], StructHandle(self.state, state_kind)

    def kinds_for(self, use: Use) -> tuple[Kind, ...]:
        """Return the kinds of all arguments of a kernel."""
        return *self.kinds, *use.others

    def is_ready(self, uses: Sequence[Use]) -> bool:
        """True if no kernel need be compiled."""
        return all(use.kernel.is_ready(*self.kinds_for(use)) for use in uses)


def prepare(models: Sequence[Model], state: State, requested: str | None = None) -> Prepared:
    """Choose the kernel for models of one kind. requested: a KernelName; the general one if None. Raises ValueError for
    an unknown name."""
    return Prepared(models, state, read_kernel_name(requested))
