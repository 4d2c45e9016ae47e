"""What a compiled callback needs and Numba has not: memory at an address, functions at an address, a clock, and
numbers that two threads share. In compiled code only."""

import sys
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import lower_builtin, type_callable

from engine.vector import INDEX, Vector

WORD = ir.IntType(64)
BYTE = ir.IntType(8)


def ints(address: int, size: int) -> Any:
    """Whole numbers of 64 bits at an address, as a Vector."""
    raise TypeError("ints is for compiled code")


def floats(address: int, size: int) -> Any:
    """Numbers of double precision at an address, as a Vector."""
    raise TypeError("floats is for compiled code")


def singles(address: int, size: int) -> Any:
    """Numbers of single precision at an address, as a Vector."""
    raise TypeError("singles is for compiled code")


def watch(numbers: Any, i: int) -> int:
    """Number i of a Vector that another thread writes: all that it wrote before is seen after (acquire)."""
    raise TypeError("watch is for compiled code")


def publish(numbers: Any, i: int, value: int) -> None:
    """Set number i of a Vector that another thread watches: all written before is seen there (release)."""
    raise TypeError("publish is for compiled code")


def invoke(function: int, numbers: Any) -> None:
    """Call a function at an address, of as many whole numbers or addresses as a tuple holds."""
    raise TypeError("invoke is for compiled code")


def clock() -> float:
    """Seconds since some beginning; never goes back."""
    raise TypeError("clock is for compiled code")


def _memory(function: Callable[..., Any], dtype: types.Type) -> None:
    """Let a function give a Vector of a type."""

    @type_callable(function)
    def kind(context: Any) -> Any:
        return lambda address, size: Vector(dtype)

    @lower_builtin(function, types.Any, types.Integer)
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
        pointer = context.get_data_type(dtype).as_pointer()
        address = args[0]
        made.data = (
            builder.inttoptr(address, pointer)
            if isinstance(address.type, ir.IntType)
            else builder.bitcast(address, pointer)
        )
        made.size = context.cast(builder, args[1], sig.args[1], INDEX)
        return made._getvalue()


_memory(ints, types.int64)
_memory(floats, types.float64)
_memory(singles, types.float32)


def _at(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    vector = cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0])
    return builder.gep(vector.data, [context.cast(builder, args[1], sig.args[1], INDEX)])


@type_callable(watch)
def _type_watch(context: Any) -> Any:
    return lambda numbers, i: types.int64


@lower_builtin(watch, Vector, types.Integer)
def _watch(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load_atomic(_at(context, builder, sig, args), "acquire", 8)


@type_callable(publish)
def _type_publish(context: Any) -> Any:
    return lambda numbers, i, value: types.none


@lower_builtin(publish, Vector, types.Integer, types.Integer)
def _publish(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    value = context.cast(builder, args[2], sig.args[2], types.int64)
    builder.store_atomic(value, _at(context, builder, sig, args), "release", 8)
    return context.get_dummy_value()


@type_callable(invoke)
def _type_invoke(context: Any) -> Any:
    return lambda function, numbers: types.none


@lower_builtin(invoke, types.Integer, types.BaseTuple)
def _invoke(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    numbers = cgutils.unpack_tuple(builder, args[1])
    kind = ir.FunctionType(ir.VoidType(), [n.type for n in numbers]).as_pointer()
    builder.call(builder.inttoptr(args[0], kind), numbers)
    return context.get_dummy_value()


@type_callable(clock)
def _type_clock(context: Any) -> Any:
    return lambda: types.float64


@lower_builtin(clock)
def _clock(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    room = cgutils.alloca_once(builder, ir.ArrayType(WORD, 2))
    pointer = builder.bitcast(room, BYTE.as_pointer())
    double = ir.DoubleType()
    if sys.platform == "win32":
        ticks = []
        for name in ("QueryPerformanceCounter", "QueryPerformanceFrequency"):
            kind = ir.FunctionType(ir.IntType(32), [BYTE.as_pointer()])
            builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [pointer])
            ticks.append(builder.sitofp(builder.load(builder.bitcast(room, WORD.as_pointer())), double))
        return builder.fdiv(*ticks)
    monotonic = ir.Constant(ir.IntType(32), 6 if sys.platform == "darwin" else 1)
    kind = ir.FunctionType(ir.IntType(32), [ir.IntType(32), BYTE.as_pointer()])
    builder.call(cgutils.get_or_insert_function(builder.module, kind, "clock_gettime"), [monotonic, pointer])
    seconds, nanoseconds = (builder.load(cgutils.gep_inbounds(builder, room, 0, n)) for n in (0, 1))
    fraction = builder.fmul(builder.sitofp(nanoseconds, double), ir.Constant(double, 1e-9))
    return builder.fadd(builder.sitofp(seconds, double), fraction)
