"""A tuple of arrays as compiled code has it, made once and kept: kernels are then given its address.

To unpack a scene of a hundred arrays takes 60 µs, a quarter of a short block; and who calls from outside Python, as
an audio driver does, has nothing but addresses.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import types
from numba.core.registry import cpu_target
from numba.extending import NativeValue, lower_builtin, models, register_model, type_callable, typeof_impl, unbox

from engine.jit import entry


class Held:
    """A value in the form of compiled code. Arrays in it stay where they are, and are kept alive."""

    def __init__(self, value: Any) -> None:
        self.value, self.kind = value, HeldType(typeof(value))
        context = cpu_target.target_context
        size = context.get_abi_sizeof(context.get_data_type(self.kind.dtype))
        self._bytes = np.zeros(-(-size // 8) + 1, np.int64)
        self.address = self._bytes.ctypes.data
        _hold(value, self.address)


class HeldType(types.Type):
    """The Numba type of the address of a value of some type."""

    def __init__(self, dtype: types.Type) -> None:
        self.dtype = dtype
        super().__init__(name=f"Held({dtype})")


@typeof_impl.register(Held)
def _typeof(held: Held, context: Any) -> HeldType:
    return held.kind


@register_model(HeldType)
class _HeldModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: HeldType) -> None:
        super().__init__(manager, kind, ir.IntType(8).as_pointer())


@unbox(HeldType)
def _unbox(kind: HeldType, held: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(held, "address")
    native = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(native)


def let(held: Any) -> Any:
    """The value that is held; in compiled code only."""
    raise TypeError("let is for compiled code")


def put(value: Any, address: int) -> None:
    """Write a value to an address, to be held; in compiled code only."""
    raise TypeError("put is for compiled code")


@type_callable(let)
def _type_let(context: Any) -> Any:
    return lambda held: held.dtype if isinstance(held, HeldType) else None


@lower_builtin(let, HeldType)
def _let(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.return_type
    return context.unpack_value(builder, kind, builder.bitcast(args[0], context.get_data_type(kind).as_pointer()))


@type_callable(put)
def _type_put(context: Any) -> Any:
    return lambda value, address: types.none


@lower_builtin(put, types.Any, types.Integer)
def _put(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0]
    place = builder.inttoptr(args[1], context.get_data_type(kind).as_pointer())
    context.pack_value(builder, kind, args[0], place)
    return context.get_dummy_value()


@entry
def _hold(value, address):
    put(value, address)
