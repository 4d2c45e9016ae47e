"""A Model or a State stored once in Numba's native layout, so that a kernel takes one address.

To unpack a scene of a hundred arrays at each call takes 60 µs, a quarter of a short block; and an audio driver, which
calls from outside Python, has nothing but addresses.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.registry import cpu_target
from numba.extending import NativeValue, lower_builtin, models, register_model, type_callable, typeof_impl, unbox

from engine.compiler.decorators import kernel


class StructHandle:
    """A tuple of arrays in native layout. The arrays stay where they are, and are kept alive."""

    def __init__(self, value: Any) -> None:
        self.value, self.kind = value, StructHandleType(typeof(value))
        context = cpu_target.target_context
        size = context.get_abi_sizeof(context.get_data_type(self.kind.dtype))
        self._bytes = np.zeros(-(-size // 8) + 1, np.int64)
        self.address = self._bytes.ctypes.data
        _store(value, self.address)


class StructHandleType(types.Type):
    """The Numba type of the address of a value of some type."""

    def __init__(self, dtype: types.Type) -> None:
        self.dtype = dtype
        super().__init__(name=f"StructHandle({dtype})")


@typeof_impl.register(StructHandle)
def _typeof(held: StructHandle, context: Any) -> StructHandleType:
    return held.kind


@register_model(StructHandleType)
class _StructHandleModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: StructHandleType) -> None:
        super().__init__(manager, kind, ir.IntType(8).as_pointer())


@unbox(StructHandleType)
def _unbox(kind: StructHandleType, held: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(held, "address")
    native = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(native)


def load_struct(held: Any) -> Any:
    """The tuple that a handle points to; in compiled code only."""
    raise TypeError("load_struct is for compiled code")


def store_struct(value: Any, address: int) -> None:
    """Write a tuple to an address in native layout; in compiled code only."""
    raise TypeError("store_struct is for compiled code")


@type_callable(load_struct)
def _type_load(context: Any) -> Any:
    return lambda held: held.dtype if isinstance(held, StructHandleType) else None


@lower_builtin(load_struct, StructHandleType)
def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.return_type
    return context.unpack_value(builder, kind, builder.bitcast(args[0], context.get_data_type(kind).as_pointer()))


@type_callable(store_struct)
def _type_store(context: Any) -> Any:
    return lambda value, address: types.none


@lower_builtin(store_struct, types.Any, types.Integer)
def _lower_store(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0]
    place = builder.inttoptr(args[1], context.get_data_type(kind).as_pointer())
    context.pack_value(builder, kind, _disown(context, builder, kind, args[0]), place)
    return context.get_dummy_value()


def _disown(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A value whose arrays hold no reference to their memory: that of a call ends with the call."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        for owner in ("meminfo", "parent"):
            setattr(array, owner, ir.Constant(getattr(array, owner).type, None))
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        kinds: Any = kind.types  # type: ignore[attr-defined]  # of any tuple
        items = zip(kinds, cgutils.unpack_tuple(builder, value), strict=True)
        return context.make_tuple(builder, kind, [_disown(context, builder, *item) for item in items])
    return value


@kernel
def _store(value, address):
    store_struct(value, address)
