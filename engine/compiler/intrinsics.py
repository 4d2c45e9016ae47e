"""Operations that a compiled callback needs and Numba lacks: memory at an address, functions at an address, a clock,
and numbers that two threads share. In compiled code only."""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types

from engine.compiler.array_view import INDEX, ArrayView1D
from engine.compiler.intrinsic import intrinsic

WORD = ir.IntType(64)
BYTE = ir.IntType(8)


def _view(dtype: types.Type, address: Any, size: Any) -> Any:
    """Return the signature and the code of a view of numbers of a type."""

    def view(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
        pointer = context.get_data_type(dtype).as_pointer()
        is_integer = isinstance(args[0].type, ir.IntType)
        made.data = builder.inttoptr(args[0], pointer) if is_integer else builder.bitcast(args[0], pointer)
        made.size = context.cast(builder, args[1], sig.args[1], INDEX)
        return made._getvalue()

    return ArrayView1D(dtype)(address, size), view


@intrinsic
def int64_view(address: Any, size: Any) -> Any:
    """Return a view of 64-bit integers at an address."""
    return _view(types.int64, address, size)


@intrinsic
def float64_view(address: Any, size: Any) -> Any:
    """Return a view of double-precision numbers at an address."""
    return _view(types.float64, address, size)


@intrinsic
def float32_view(address: Any, size: Any) -> Any:
    """Return a view of single-precision numbers at an address."""
    return _view(types.float32, address, size)


def _at(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the address of number args[1] of an array or a view."""
    vector = cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0])
    return builder.gep(vector.data, [context.cast(builder, args[1], sig.args[1], INDEX)])


@intrinsic
def load_acquire(numbers: Any, i: Any) -> Any:
    """Return number i of an array that another thread writes. All that it wrote before is visible afterwards
    (acquire)."""
    return types.int64(numbers, i), lambda context, builder, sig, args: builder.load_atomic(
        _at(context, builder, sig, args), "acquire", 8
    )


@intrinsic
def store_release(numbers: Any, i: Any, value: Any) -> Any:
    """Set number i of an array that another thread reads. All that was written before is visible there (release)."""

    def store(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        new = context.cast(builder, args[2], sig.args[2], types.int64)
        builder.store_atomic(new, _at(context, builder, sig, args), "release", 8)
        return context.get_dummy_value()

    return types.none(numbers, i, value), store


def _change(operation: str, numbers: Any, i: Any, value: Any) -> Any:
    """Return the signature and the code of a change of a shared number by an operation of LLVM."""

    def change(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        new = context.cast(builder, args[2], sig.args[2], types.int64)
        return builder.atomic_rmw(operation, _at(context, builder, sig, args), new, "seq_cst")

    return types.int64(numbers, i, value), change


@intrinsic
def atomic_add(numbers: Any, i: Any, change: Any) -> Any:
    """Add to number i of an array that several threads change, and return its old value. All threads see such changes
    in one order."""
    return _change("add", numbers, i, change)


@intrinsic
def atomic_exchange(numbers: Any, i: Any, value: Any) -> Any:
    """Set number i of an array that several threads change, and return its old value. All threads see such changes in
    one order."""
    return _change("xchg", numbers, i, value)


@intrinsic
def call_address(function: Any, numbers: Any) -> Any:
    """Call the function at an address with the integers or addresses in a tuple."""

    def call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        given = cgutils.unpack_tuple(builder, args[1])
        kind = ir.FunctionType(ir.VoidType(), [number.type for number in given]).as_pointer()
        builder.call(builder.inttoptr(args[0], kind), given)
        return context.get_dummy_value()

    return types.none(function, numbers), call


@intrinsic
def monotonic_seconds(clock: Any) -> Any:
    """Return the seconds since an arbitrary start. They never go back. clock: address of a Clock
    (engine.compiler.clock)"""
    return types.float64(clock), _seconds


def _seconds(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    double, room = ir.DoubleType(), cgutils.alloca_once(builder, ir.ArrayType(WORD, 2), zfill=True)
    words = builder.inttoptr(context.cast(builder, args[0], sig.args[0], types.int64), WORD.as_pointer())
    function, first, *units = (builder.load(builder.gep(words, [WORD(n)])) for n in range(4))
    place = builder.ptrtoint(room, WORD)
    given = builder.select(builder.icmp_signed("<", first, WORD(0)), place, first)
    builder.call(builder.inttoptr(function, ir.FunctionType(WORD, [WORD, WORD]).as_pointer()), [given, place])
    counts = (builder.sitofp(builder.load(cgutils.gep_inbounds(builder, room, 0, n)), double) for n in (0, 1))
    parts = [builder.fmul(count, builder.bitcast(unit, double)) for count, unit in zip(counts, units, strict=True)]
    return builder.fadd(*parts)
