"""The Numba type of a StructHandle, and functions that read the tuple at its address."""

from typing import Any

from llvmlite import ir
from numba import typeof
from numba.core import types
from numba.extending import NativeValue, models, register_model, typeof_impl, unbox

from engine.compiler.intrinsic import intrinsic
from engine.compiler.struct_handle import StructHandle


class StructHandleType(types.Type):
    """The Numba type of the address of a value of some type."""

    def __init__(self, dtype: types.Type) -> None:
        self.dtype = dtype
        super().__init__(name=f"StructHandle({dtype})")


@typeof_impl.register(StructHandle)
def _typeof(held: StructHandle, context: Any) -> StructHandleType:
    return StructHandleType(typeof(held.value))


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


@intrinsic
def load_struct(held: Any) -> Any:
    """Return the tuple that a handle points to."""
    return held.dtype(held), lambda context, builder, sig, args: _load(context, builder, held.dtype, args[0])


@intrinsic
def load_struct_like(value: Any, address: Any) -> Any:
    """Return the tuple at an address, of the type of another tuple."""

    def load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _load(context, builder, value, builder.inttoptr(args[1], ir.IntType(8).as_pointer()))

    return value(value, address), load


def _load(context: Any, builder: Any, kind: Any, address: Any) -> Any:
    return context.unpack_value(builder, kind, builder.bitcast(address, context.get_data_type(kind).as_pointer()))
