"""Vectors of eight double-precision numbers, as vector code on any processor. In compiled code only.

`Lanes` are added, subtracted, multiplied and divided as numbers are, by each other or by a number. Each operation is
rounded like that of a single number, and sums are taken in a fixed order. So the bits do not depend on the vector width
of the processor, as those of sums that the compiler may reorder do.

Without the trick LANES, the same is done number by number.
"""

import math
import operator
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model, type_callable

from engine.compiler.array_view import INDEX
from engine.compiler.intrinsic import intrinsic
from engine.compiler.tricks import Trick, in_use

WIDTH = 8
DOUBLE, INT32 = ir.DoubleType(), ir.IntType(32)
VECTOR = ir.VectorType(DOUBLE, WIDTH)
NUMBER_BYTES = 8


class Lanes(types.Type):
    """The Numba type of eight double-precision numbers."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES = Lanes()
AS_VECTORS = in_use(Trick.LANES, lambda: str(VECTOR) == "<8 x double>")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, VECTOR)


class EightFrom(NamedTuple):
    """Index of eight numbers of an array, from one on. With it, code for one number (`number_at`, `put_number`) handles
    eight."""

    first: int


class FewFrom(NamedTuple):
    """Index of fewer than eight numbers of an array, from one on. The other lanes are read as zeros, and are not
    written."""

    first: int
    size: int


def _constant(x: float) -> Any:
    return ir.Constant(VECTOR, [x] * WIDTH)


def _spread(builder: Any, x: Any) -> Any:
    """Return a vector with x in each lane."""
    undefined = ir.Constant(ir.VectorType(x.type, WIDTH), ir.Undefined)
    first = builder.insert_element(undefined, x, INT32(0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(INT32, WIDTH), [0] * WIDTH))


def _as_lanes(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return a value as lanes; a number is the same in each."""
    if isinstance(kind, Lanes):
        return value
    return _spread(builder, context.cast(builder, value, kind, types.float64))


def _each(builder: Any, operation: Callable[..., Any], *operands: Any) -> Any:
    """Do an operation on all lanes: at once, or one after the other without the trick LANES."""
    if AS_VECTORS:
        return operation(*operands)
    made = ir.Constant(VECTOR, ir.Undefined)
    for lane in range(WIDTH):
        part = operation(*(builder.extract_element(x, INT32(lane)) for x in operands))
        made = builder.insert_element(made, part, INT32(lane))
    return made


def _intrinsic(name: str, builder: Any, *operands: Any) -> Any:
    """Call a function that LLVM knows, on numbers or on vectors."""
    kind = operands[0].type
    suffix = "v8f64" if isinstance(kind, ir.VectorType) else "f64"
    function = ir.FunctionType(kind, [kind] * len(operands))
    return builder.call(cgutils.get_or_insert_function(builder.module, function, f"llvm.{name}.{suffix}"), operands)


def _address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    data = cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0]).data
    return builder.gep(data, [context.cast(builder, args[1], sig.args[1], INDEX)], inbounds=True)


def _pointer(context: Any, builder: Any, numbers: Any, kind: Any, k: Any, index_kind: Any) -> Any:
    data = cgutils.create_struct_proxy(kind)(context, builder, numbers).data
    first = builder.gep(data, [context.cast(builder, k, index_kind, INDEX)], inbounds=True)
    return builder.bitcast(first, ir.VectorType(context.get_data_type(kind.dtype), WIDTH).as_pointer())


class _Arithmetic(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        known = [isinstance(kind, Lanes | types.Float | types.Integer) for kind in args]
        if len(args) == 2 and all(known) and any(isinstance(kind, Lanes) for kind in args):
            return signature(LANES, *args)
        return None


def _declare(symbol: Any, instruction: str) -> None:
    """Let compiled code use a Python operator on lanes."""
    infer_global(symbol)(type(f"_{instruction}", (_Arithmetic,), {"key": symbol}))

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        operands = [_as_lanes(context, builder, kind, x) for kind, x in zip(sig.args, args, strict=True)]
        return _each(builder, getattr(builder, instruction), *operands)

    for kinds in ((Lanes, Lanes), (Lanes, types.Number), (types.Number, Lanes)):
        lower_builtin(symbol, *kinds)(lower)


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.iadd, "fadd"),
    (operator.sub, "fsub"),
    (operator.isub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _declare(_symbol, _instruction)

# --- memory


def _first_lanes(context: Any, builder: Any, kind: Any, count: Any) -> Any:
    """Return a mask of the first `count` lanes."""
    several = _spread(builder, context.cast(builder, count, kind, INDEX))
    return builder.icmp_signed("<", ir.Constant(several.type, list(range(WIDTH))), several)


def _masked(builder: Any, operation: str, result: Any, operands: list[Any]) -> Any:
    """Call LLVM's masked load or store of the lanes at a pointer."""
    name = f"llvm.masked.{operation}.v{WIDTH}f64.p0v{WIDTH}f64"
    function = ir.FunctionType(result, [operand.type for operand in operands])
    return builder.call(cgutils.get_or_insert_function(builder.module, function, name), operands)


def _load(context: Any, builder: Any, array: Any, numbers: Any, place: list[Any], kind: Any) -> Any:
    """Return eight numbers of an array, or fewer. place: the first, and how many if they are fewer; kind: of both"""
    pointer = _pointer(context, builder, numbers, array, place[0], kind)
    if len(place) == 2:
        mask = _first_lanes(context, builder, kind, place[1])
        return _masked(builder, "load", VECTOR, [pointer, INT32(NUMBER_BYTES), mask, _constant(0.0)])
    loaded = builder.load(pointer)
    loaded.align = NUMBER_BYTES
    return loaded


def _store(context: Any, builder: Any, typed: tuple[Any, Any], place: list[Any], kind: Any, lanes: Any) -> Any:
    """Write eight numbers to an array, or fewer; `place` and `kind` as of `_load`. typed: the array, after its type"""
    array, numbers = typed
    pointer = _pointer(context, builder, numbers, array, place[0], kind)
    if len(place) == 2:
        mask = _first_lanes(context, builder, kind, place[1])
        _masked(builder, "store", ir.VoidType(), [lanes, pointer, INT32(NUMBER_BYTES), mask])
    else:
        builder.store(lanes, pointer, align=NUMBER_BYTES)
    return context.get_dummy_value()


@intrinsic
def load_lanes(numbers: Any, k: Any) -> Any:
    """Return eight numbers of a contiguous array, from number k on."""
    return LANES(numbers, k), lambda context, builder, sig, args: _load(
        context, builder, sig.args[0], args[0], [args[1]], sig.args[1]
    )


@intrinsic
def load_first_lanes(numbers: Any, k: Any, count: Any) -> Any:
    """Return `count` numbers, fewer than eight, of a contiguous array from number k on. The other lanes are zero, and
    nothing is read for them."""

    def load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = [context.cast(builder, x, kind, INDEX) for x, kind in zip(args[1:], sig.args[1:], strict=True)]
        return _load(context, builder, sig.args[0], args[0], place, INDEX)

    return LANES(numbers, k, count), load


@intrinsic
def store_lanes(numbers: Any, k: Any, lanes: Any) -> Any:
    """Write eight numbers to a contiguous array, from number k on."""
    return types.none(numbers, k, lanes), lambda context, builder, sig, args: _store(
        context, builder, (sig.args[0], args[0]), [args[1]], sig.args[1], args[2]
    )


@intrinsic
def number_at(numbers: Any, place: Any) -> Any:
    """Return the number of an array at an index; or eight numbers at an EightFrom or FewFrom."""

    def lanes_at(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        places = cgutils.unpack_tuple(builder, args[1])
        return _load(context, builder, sig.args[0], args[0], places, sig.args[1][0])

    def one_at(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.unpack_value(builder, numbers.dtype, _address(context, builder, sig, args))

    is_several = isinstance(place, types.BaseTuple)
    return (LANES(numbers, place), lanes_at) if is_several else (types.float64(numbers, place), one_at)


@intrinsic
def put_number(numbers: Any, place: Any, value: Any) -> Any:
    """Write a number to an array at an index; or several numbers at an EightFrom or FewFrom."""

    def put_lanes(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        places = cgutils.unpack_tuple(builder, args[1])
        return _store(context, builder, (sig.args[0], args[0]), places, sig.args[1][0], args[2])

    def put_one(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        number = context.cast(builder, args[2], sig.args[2], numbers.dtype)
        context.pack_value(builder, numbers.dtype, number, _address(context, builder, sig, args))
        return context.get_dummy_value()

    is_several = isinstance(place, types.BaseTuple)
    return types.none(numbers, place, value), put_lanes if is_several else put_one


@intrinsic
def place_after(place: Any, by: Any) -> Any:
    """Return the index, EightFrom or FewFrom of so many numbers further on."""

    def after(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if isinstance(place, types.Integer):
            return builder.add(args[0], context.cast(builder, args[1], sig.args[1], place))
        first, *size = cgutils.unpack_tuple(builder, args[0])
        moved = builder.add(first, context.cast(builder, args[1], sig.args[1], place[0]))
        return context.make_tuple(builder, place, [moved, *size])

    return place(place, by), after


# --- values


def _on_lanes(operation: Callable[..., Any], *kinds: Any) -> Any:
    """Return the signature and the code of an operation on lanes; a number stands for the same in each. On numbers
    alone, it gives a number. operation: takes the builder and as many values as there are kinds"""

    def on_lanes(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        operands = [_as_lanes(context, builder, kind, x) for kind, x in zip(sig.args, args, strict=True)]
        return _each(builder, lambda *lanes: operation(builder, *lanes), *operands)

    def on_numbers(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        numbers = [context.cast(builder, x, kind, types.float64) for kind, x in zip(sig.args, args, strict=True)]
        return operation(builder, *numbers)

    has_lanes = any(isinstance(kind, Lanes) for kind in kinds)
    return (LANES(*kinds), on_lanes) if has_lanes else (types.float64(*kinds), on_numbers)


def _larger(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


def _chosen(builder: Any, test: Any, yes: Any, no: Any) -> Any:
    zero = _constant(0.0) if isinstance(test.type, ir.VectorType) else DOUBLE(0.0)
    return builder.select(builder.fcmp_ordered(">", test, zero), yes, no)


@intrinsic
def splat(x: Any) -> Any:
    """Return the same number in each lane."""
    return LANES(x), lambda context, builder, sig, args: _as_lanes(context, builder, sig.args[0], args[0])


@intrinsic
def zero_like(value: Any) -> Any:
    """Return zero, or eight zeros where `value` is eight numbers."""
    is_several = isinstance(value, Lanes)
    kind, zero = (LANES, _constant(0.0)) if is_several else (types.float64, DOUBLE(0.0))
    return kind(value), lambda context, builder, sig, args: zero


@intrinsic
def multiply_add(a: Any, b: Any, c: Any) -> Any:
    """Return a·b + c, rounded once. A number stands for the same in each lane; all three may be numbers."""
    return _on_lanes(partial(_intrinsic, "fma"), a, b, c)


@intrinsic
def where_positive(test: Any, yes: Any, no: Any) -> Any:
    """Return `yes` in the lanes where `test` > 0, and `no` elsewhere. A number stands for the same in each lane; all
    three may be numbers."""
    return _on_lanes(_chosen, test, yes, no)


@intrinsic
def greater(a: Any, b: Any) -> Any:
    """Return the greater of each two lanes; that of `b` where one is not a number."""
    return _on_lanes(_larger, a, b)


@intrinsic
def magnitude(value: Any) -> Any:
    """Return the absolute value of each lane, or of a number."""
    return _on_lanes(partial(_intrinsic, "fabs"), value)


def _fold(builder: Any, lanes: Any, join: Callable[..., Any]) -> Any:
    """Join the lanes to one number: the two halves lane by lane, and so on."""
    width = WIDTH
    while width > 1:
        width //= 2
        order = [ir.Constant(ir.VectorType(INT32, width), [first + n for n in range(width)]) for first in (0, width)]
        undefined = ir.Constant(lanes.type, ir.Undefined)
        lanes = join(builder, *(builder.shuffle_vector(lanes, undefined, half) for half in order))
    return builder.extract_element(lanes, INT32(0))


def _sum(builder: Any, a: Any, b: Any) -> Any:
    return builder.fadd(a, b)


@intrinsic
def lane_sum(lanes: Any) -> Any:
    """Return the sum of the lanes: the two halves are added lane by lane, and so on. For a tuple of Lanes, return the
    tuple of their sums."""

    def sums(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        several = [_fold(builder, one, _sum) for one in cgutils.unpack_tuple(builder, args[0])]
        return context.make_tuple(builder, sig.return_type, several)

    if isinstance(lanes, types.UniTuple):
        return types.UniTuple(types.float64, len(lanes))(lanes), sums
    return types.float64(lanes), lambda context, builder, sig, args: _fold(builder, args[0], _sum)


@intrinsic
def lane_maximum(lanes: Any) -> Any:
    """Return the largest of the lanes, none of which may be "not a number"."""
    return types.float64(lanes), lambda context, builder, sig, args: _fold(builder, args[0], _larger)


@type_callable(math.sqrt)
def _type_sqrt(context: Any) -> Any:
    return lambda x: LANES if isinstance(x, Lanes) else None


@lower_builtin(math.sqrt, Lanes)
def _sqrt(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _each(builder, lambda x: _intrinsic("sqrt", builder, x), args[0])
