"""Operations that a compiled callback needs and Numba lacks: memory at an address, functions at an address, a clock,
and numbers that two threads share. In compiled code only."""

import sys
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import lower_builtin, type_callable

from engine.compiler.array_view import INDEX, ArrayView1D

WORD = ir.IntType(64)
BYTE = ir.IntType(8)


def int64_view(address: int, size: int) -> Any:
    """Return a view of 64-bit integers at an address."""
    raise TypeError("int64_view is for compiled code")


def float64_view(address: int, size: int) -> Any:
    """Return a view of double-precision numbers at an address."""
    raise TypeError("float64_view is for compiled code")


def float32_view(address: int, size: int) -> Any:
    """Return a view of single-precision numbers at an address."""
    raise TypeError("float32_view is for compiled code")


def load_acquire(numbers: Any, i: int) -> int:
    """Return number i of a view that another thread writes. All that it wrote before is visible afterwards
    (acquire)."""
    raise TypeError("load_acquire is for compiled code")


def store_release(numbers: Any, i: int, value: int) -> None:
    """Set number i of a view that another thread reads. All that was written before is visible there (release)."""
    raise TypeError("store_release is for compiled code")


def atomic_add(numbers: Any, i: int, change: int) -> int:
    """Add to number i of a view that several threads change, and return its old value. All threads see such changes in
    one order."""
    raise TypeError("atomic_add is for compiled code")


def atomic_exchange(numbers: Any, i: int, value: int) -> int:
    """Set number i of a view that several threads change, and return its old value. All threads see such changes in one
    order."""
    raise TypeError("atomic_exchange is for compiled code")


def call_address(function: int, numbers: Any) -> None:
    """Call the function at an address with the integers or addresses in a tuple."""
    raise TypeError("call_address is for compiled code")


def monotonic_seconds() -> float:
    """Return the seconds since an arbitrary start. They never go back."""
    raise TypeError("monotonic_seconds is for compiled code")


def _memory(function: Callable[..., Any], dtype: types.Type) -> None:
    """Let a function return a view of numbers of a type."""

    @type_callable(function)
    def kind(context: Any) -> Any:
        return lambda address, size: ArrayView1D(dtype)

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


_memory(int64_view, types.int64)
_memory(float64_view, types.float64)
_memory(float32_view, types.float32)


def _at(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    vector = cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0])
    return builder.gep(vector.data, [context.cast(builder, args[1], sig.args[1], INDEX)])


@type_callable(load_acquire)
def _type_load(context: Any) -> Any:
    return lambda numbers, i: types.int64


@lower_builtin(load_acquire, ArrayView1D, types.Any)
@lower_builtin(load_acquire, types.Array, types.Any)
def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.load_atomic(_at(context, builder, sig, args), "acquire", 8)


@type_callable(store_release)
def _type_store(context: Any) -> Any:
    return lambda numbers, i, value: types.none


@lower_builtin(store_release, ArrayView1D, types.Any, types.Integer)
@lower_builtin(store_release, types.Array, types.Any, types.Integer)
def _store(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    value = context.cast(builder, args[2], sig.args[2], types.int64)
    builder.store_atomic(value, _at(context, builder, sig, args), "release", 8)
    return context.get_dummy_value()


def _let_change(function: Callable[..., Any], operation: str) -> None:
    """Let compiled code change a shared number by an operation of LLVM."""

    @type_callable(function)
    def kind(context: Any) -> Any:
        return lambda numbers, i, value: types.int64

    @lower_builtin(function, ArrayView1D, types.Any, types.Integer)
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        value = context.cast(builder, args[2], sig.args[2], types.int64)
        return builder.atomic_rmw(operation, _at(context, builder, sig, args), value, "seq_cst")


_let_change(atomic_add, "add")
_let_change(atomic_exchange, "xchg")


@type_callable(call_address)
def _type_call(context: Any) -> Any:
    return lambda function, numbers: types.none


@lower_builtin(call_address, types.Integer, types.BaseTuple)
def _call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    numbers = cgutils.unpack_tuple(builder, args[1])
    kind = ir.FunctionType(ir.VoidType(), [n.type for n in numbers]).as_pointer()
    builder.call(builder.inttoptr(args[0], kind), numbers)
    return context.get_dummy_value()


@type_callable(monotonic_seconds)
def _type_seconds(context: Any) -> Any:
    return lambda: types.float64


@lower_builtin(monotonic_seconds)
def _seconds(context: Any, builder: Any, sig: Any, args: Any) -> Any:
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
