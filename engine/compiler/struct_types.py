"""The Numba type of a StructHandle, and functions that read the tuple at its address."""

from typing import Any

from llvmlite import ir
from numba import typeof
from numba.core import types
from numba.extending import NativeValue, lower_builtin, models, register_model, type_callable, typeof_impl, unbox

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


def load_struct(held: Any) -> Any:
    """Return the tuple that a handle points to; in compiled code only."""
    raise TypeError("load_struct is for compiled code")


@type_callable(load_struct)
def _type_load(context: Any) -> Any:
    return lambda held: held.dtype if isinstance(held, StructHandleType) else None


@lower_builtin(load_struct, StructHandleType)
def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.return_type
    return context.unpack_value(builder, kind, builder.bitcast(args[0], context.get_data_type(kind).as_pointer()))


def load_struct_like(value: Any, address: int) -> Any:
    """Return the tuple at an address, of the type of another tuple; in compiled code only."""
    raise TypeError("load_struct_like is for compiled code")


@type_callable(load_struct_like)
def _type_load_like(context: Any) -> Any:
    return lambda value, address: value


@lower_builtin(load_struct_like, types.BaseTuple, types.Integer)
def _load_like(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.return_type
    return context.unpack_value(builder, kind, builder.inttoptr(args[1], context.get_data_type(kind).as_pointer()))
