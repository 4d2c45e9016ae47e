"""Chooses the kernel that runs a model: a special one, compiled for the effects of the scene and nothing else, or the
general one, which has every effect and runs any scene (engine.assembly.general). The samples are the same, bit for bit.

A special kernel takes 10 s to compile. A scene whose special kernel is not there runs on the general one at once, while
the special one is compiled beside it, for the next time. The general kernel comes with the engine; where that does not
fit the processor, it is compiled once, and all scenes start at once from then on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from engine.assembly.general import generalise
from engine.compiler.background import Request
from engine.compiler.kernel_name import KernelName, read_kernel_name
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import Kind
from engine.compiler.struct_handle import StructHandle, pointer_kind
from engine.kernel.data.model import Model
from engine.kernel.data.state import State


class Use(NamedTuple):
    """A kernel that is to run with a Model and a State, and the kinds of its other arguments."""

    kernel: Kernel
    others: tuple[Kind, ...]


@dataclass(frozen=True)
class Prepared:
    """Models and a state that fit the chosen kernel and share the arrays given, and the name of the kernel."""

    models: list[Model]
    state: State
    name: KernelName
    missing: Sequence[Request] = ()  # kernels to compile for the next time

    @cached_property
    def kinds(self) -> tuple[Kind, Kind]:
        """The kinds of a pointer to the model, and of one to the state."""
        return pointer_kind(self.models[0]), pointer_kind(self.state)

    def handles(self) -> tuple[list[StructHandle], StructHandle]:
        """Return the models and the state in the layout of compiled code."""
        model_kind, state_kind = self.kinds
        return [StructHandle(model, model_kind) for model in self.models], StructHandle(self.state, state_kind)


def prepare(models: Sequence[Model], state: State, uses: Sequence[Use], requested: str | None = None) -> Prepared:
    """Choose the kernel for models of one kind, and make them fit it.

    requested: a KernelName; None: what the environment says, or AUTO
    Raises ValueError for an unknown name.
    """
    name = read_kernel_name(requested)
    special = Prepared(list(models), state, KernelName.SPECIAL)
    if name is KernelName.SPECIAL or (name is KernelName.AUTO and is_ready(special, uses)):
        return special
    pairs = [generalise(model, state) for model in models]
    general = Prepared([model for model, _ in pairs], pairs[0][1], KernelName.GENERAL)
    if name is KernelName.GENERAL:
        return general
    return replace(general, missing=[*requests_of(special, uses), *requests_of(general, uses)])


def kinds_of(prepared: Prepared, use: Use) -> tuple[Kind, ...]:
    """The kinds of all arguments of a kernel."""
    return *prepared.kinds, *use.others


def requests_of(prepared: Prepared, uses: Sequence[Use]) -> list[Request]:
    """The kernels as engine.compiler.background takes them."""
    return [(use.kernel.module, use.kernel.function, kinds_of(prepared, use)) for use in uses]


def is_ready(prepared: Prepared, uses: Sequence[Use]) -> bool:
    """True if no kernel need be compiled."""
    return all(use.kernel.is_ready(*kinds_of(prepared, use)) for use in uses)
