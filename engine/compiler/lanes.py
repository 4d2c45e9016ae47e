"""Vectors of eight double-precision numbers, as vector code on any processor. In compiled code only.

`Lanes` are added, subtracted, multiplied and divided as numbers are, by each other or by a number. Each operation is
rounded like that of a single number, and sums are taken in a fixed order. So the bits do not depend on the vector width
of the processor, as those of sums that the compiler may reorder do.

Without the trick LANES, the same is done number by number.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model, type_callable

from engine.compiler.array_view import INDEX, ArrayView1D
from engine.compiler.tricks import Trick, in_use

WIDTH = 8
DOUBLE, INT32 = ir.DoubleType(), ir.IntType(32)
VECTOR = ir.VectorType(DOUBLE, WIDTH)


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


def load_lanes(numbers: Any, k: int) -> Any:
    """Return eight numbers of a contiguous array, of either precision, from number k on."""
    raise TypeError("load_lanes is for compiled code")


def load_first_lanes(numbers: Any, k: int, count: int) -> Any:
    """Return `count` numbers, fewer than eight, of a contiguous array from number k on. The other lanes are zero, and
    nothing is read for them."""
    raise TypeError("load_first_lanes is for compiled code")


def store_lanes(numbers: Any, k: int, lanes: Any) -> None:
    """Write eight numbers to a contiguous array, from number k on."""
    raise TypeError("store_lanes is for compiled code")


def splat(x: float) -> Any:
    """Return the same number in each lane."""
    raise TypeError("splat is for compiled code")


def multiply_add(a: Any, b: Any, c: Any) -> Any:
    """Return a·b + c, rounded once. A number stands for the same in each lane; all three may be numbers."""
    raise TypeError("multiply_add is for compiled code")


def where_positive(test: Any, yes: Any, no: Any) -> Any:
    """Return `yes` in the lanes where `test` > 0, and `no` elsewhere. A number stands for the same in each lane; all
    three may be numbers."""
    raise TypeError("where_positive is for compiled code")


class EightFrom(NamedTuple):
    """Index of eight numbers of an array, from one on. With it, code for one number (`number_at`, `put_number`) handles
    eight."""

    first: int


class FewFrom(NamedTuple):
    """Index of fewer than eight numbers of an array, from one on. The other lanes are read as zeros, and are not
    written."""

    first: int
    size: int


def number_at(numbers: Any, place: Any) -> Any:
    """Return the number of an array at an index, in double precision; or eight numbers at an EightFrom or FewFrom."""
    raise TypeError("number_at is for compiled code")


def put_number(numbers: Any, place: Any, value: Any) -> None:
    """Write a number to an array at an index; or several numbers at an EightFrom or FewFrom."""
    raise TypeError("put_number is for compiled code")


def place_after(place: Any, by: int) -> Any:
    """Return the index, EightFrom or FewFrom of so many numbers further on."""
    raise TypeError("place_after is for compiled code")


def zero_like(value: Any) -> Any:
    """Return zero, or eight zeros where `value` is eight numbers."""
    raise TypeError("zero_like is for compiled code")


def greater(a: Any, b: Any) -> Any:
    """Return the greater of each two lanes; that of `b` where one is not a number."""
    raise TypeError("greater is for compiled code")


def magnitude(lanes: Any) -> Any:
    """Return the absolute value of each lane, or of a number."""
    raise TypeError("magnitude is for compiled code")


def lane_sum(lanes: Any) -> Any:
    """Return the sum of the lanes: the two halves are added lane by lane, and so on. For a tuple of Lanes, return the
    tuple of their sums."""
    raise TypeError("lane_sum is for compiled code")


def lane_maximum(lanes: Any) -> float:
    """Return the largest of the lanes, none of which may be "not a number"."""
    raise TypeError("lane_maximum is for compiled code")


# --- how they are compiled


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


def _intrinsic(builder: Any, name: str, *operands: Any) -> Any:
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


@type_callable(load_lanes)
def _type_load(context: Any) -> Any:
    return lambda numbers, k: LANES


@lower_builtin(load_lanes, ArrayView1D, types.Integer)
@lower_builtin(load_lanes, types.Array, types.Integer)
def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    loaded = builder.load(_pointer(context, builder, args[0], sig.args[0], args[1], sig.args[1]))
    loaded.align = sig.args[0].dtype.bitwidth // 8
    return loaded if loaded.type == VECTOR else builder.fpext(loaded, VECTOR)


def _first(context: Any, builder: Any, kind: Any, count: Any) -> Any:
    """Return a mask of the first `count` lanes."""
    several = _spread(builder, context.cast(builder, count, kind, INDEX))
    return builder.icmp_signed("<", ir.Constant(several.type, list(range(WIDTH))), several)


@type_callable(load_first_lanes)
def _type_load_first(context: Any) -> Any:
    return lambda numbers, k, count: LANES


@lower_builtin(load_first_lanes, ArrayView1D, types.Integer, types.Integer)
@lower_builtin(load_first_lanes, types.Array, types.Integer, types.Integer)
def _load_first(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer = _pointer(context, builder, args[0], sig.args[0], args[1], sig.args[1])
    numbers = pointer.type.pointee
    mask = _first(context, builder, sig.args[2], args[2])
    kind = ir.FunctionType(numbers, [pointer.type, INT32, mask.type, numbers])
    name = f"llvm.masked.load.v{WIDTH}f{sig.args[0].dtype.bitwidth}.p0v{WIDTH}f{sig.args[0].dtype.bitwidth}"
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    alignment = INT32(sig.args[0].dtype.bitwidth // 8)
    loaded = builder.call(function, [pointer, alignment, mask, ir.Constant(numbers, [0.0] * WIDTH)])
    return loaded if numbers == VECTOR else builder.fpext(loaded, VECTOR)


@type_callable(store_lanes)
def _type_store(context: Any) -> Any:
    return lambda numbers, k, lanes: types.none


@lower_builtin(store_lanes, ArrayView1D, types.Integer, Lanes)
@lower_builtin(store_lanes, types.Array, types.Integer, Lanes)
def _store(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer = _pointer(context, builder, args[0], sig.args[0], args[1], sig.args[1])
    numbers = args[2] if pointer.type.pointee == VECTOR else builder.fptrunc(args[2], pointer.type.pointee)
    builder.store(numbers, pointer, align=sig.args[0].dtype.bitwidth // 8)
    return context.get_dummy_value()


@type_callable(number_at)
def _type_number_at(context: Any) -> Any:
    return lambda numbers, place: LANES if isinstance(place, types.BaseTuple) else types.float64


@lower_builtin(number_at, types.Any, types.BaseTuple)
def _lanes_at(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    place, kind = cgutils.unpack_tuple(builder, args[1]), sig.args[1][0]
    if len(place) == 2:
        return _load_first(context, builder, signature(LANES, sig.args[0], kind, kind), (args[0], *place))
    return _load(context, builder, signature(LANES, sig.args[0], kind), (args[0], *place))


@lower_builtin(number_at, types.Any, types.Integer)
def _number_at(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0].dtype
    number = context.unpack_value(builder, kind, _address(context, builder, sig, args))
    return context.cast(builder, number, kind, types.float64)


@type_callable(put_number)
def _type_put_number(context: Any) -> Any:
    return lambda numbers, place, value: types.none


@lower_builtin(put_number, types.Any, types.BaseTuple, Lanes)
def _put_lanes(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    place, kind = cgutils.unpack_tuple(builder, args[1]), sig.args[1][0]
    if len(place) == 2:
        return _store_first(context, builder, sig.args[0], kind, (args[0], *place, args[2]))
    return _store(context, builder, signature(types.none, sig.args[0], kind, LANES), (args[0], *place, args[2]))


def _store_first(context: Any, builder: Any, array: Any, kind: Any, args: Any) -> Any:
    """Write the first of eight numbers to an array. args: the array, the index, the count, and the lanes"""
    numbers, k, count, lanes = args
    pointer = _pointer(context, builder, numbers, array, k, kind)
    into = pointer.type.pointee
    mask, bits = _first(context, builder, kind, count), array.dtype.bitwidth
    function = ir.FunctionType(ir.VoidType(), [into, pointer.type, INT32, mask.type])
    name = f"llvm.masked.store.v{WIDTH}f{bits}.p0v{WIDTH}f{bits}"
    stored = lanes if into == VECTOR else builder.fptrunc(lanes, into)
    builder.call(
        cgutils.get_or_insert_function(builder.module, function, name), [stored, pointer, INT32(bits // 8), mask]
    )
    return context.get_dummy_value()


@lower_builtin(put_number, types.Any, types.Integer, types.Any)
def _put_number(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0].dtype
    number = context.cast(builder, args[2], sig.args[2], kind)
    context.pack_value(builder, kind, number, _address(context, builder, sig, args))
    return context.get_dummy_value()


@type_callable(place_after)
def _type_place_after(context: Any) -> Any:
    return lambda place, by: place


@lower_builtin(place_after, types.BaseTuple, types.Integer)
def _tuple_after(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    first, *size = cgutils.unpack_tuple(builder, args[0])
    by = context.cast(builder, args[1], sig.args[1], sig.args[0][0])
    return context.make_tuple(builder, sig.return_type, [builder.add(first, by), *size])


@lower_builtin(place_after, types.Integer, types.Integer)
def _index_after(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.add(args[0], context.cast(builder, args[1], sig.args[1], sig.args[0]))


@type_callable(zero_like)
def _type_zero(context: Any) -> Any:
    return lambda value: LANES if isinstance(value, Lanes) else types.float64


@lower_builtin(zero_like, types.Any)
def _zero(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _constant(0.0) if isinstance(sig.return_type, Lanes) else DOUBLE(0.0)


@type_callable(splat)
def _type_splat(context: Any) -> Any:
    return lambda x: LANES


@lower_builtin(splat, types.Number)
def _lower_splat(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _as_lanes(context, builder, sig.args[0], args[0])


@type_callable(multiply_add)
def _type_multiply_add(context: Any) -> Any:
    return lambda a, b, c: LANES if any(isinstance(kind, Lanes) for kind in (a, b, c)) else types.float64


@lower_builtin(multiply_add, types.Any, types.Any, types.Any)
def _multiply_add(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    if sig.return_type == types.float64:
        numbers = [context.cast(builder, x, kind, types.float64) for kind, x in zip(sig.args, args, strict=True)]
        return _intrinsic(builder, "fma", *numbers)
    operands = [_as_lanes(context, builder, kind, x) for kind, x in zip(sig.args, args, strict=True)]
    return _each(builder, lambda *lanes: _intrinsic(builder, "fma", *lanes), *operands)


@type_callable(where_positive)
def _type_where(context: Any) -> Any:
    return lambda test, yes, no: LANES if isinstance(test, Lanes) else types.float64


@lower_builtin(where_positive, types.Float, types.Any, types.Any)
def _where_number(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    test, yes, no = (context.cast(builder, x, kind, types.float64) for x, kind in zip(args, sig.args, strict=True))
    return builder.select(builder.fcmp_ordered(">", test, DOUBLE(0.0)), yes, no)


@lower_builtin(where_positive, Lanes, types.Any, types.Any)
def _where(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    operands = [_as_lanes(context, builder, kind, x) for kind, x in zip(sig.args, args, strict=True)]

    def choose(test: Any, yes: Any, no: Any) -> Any:
        zero = _constant(0.0) if isinstance(test.type, ir.VectorType) else DOUBLE(0.0)
        return builder.select(builder.fcmp_ordered(">", test, zero), yes, no)

    return _each(builder, choose, *operands)


@type_callable(greater)
def _type_greater(context: Any) -> Any:
    return lambda a, b: LANES


@lower_builtin(greater, Lanes, Lanes)
def _greater(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _each(builder, lambda a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b), *args)


@type_callable(magnitude)
def _type_magnitude(context: Any) -> Any:
    return lambda lanes: lanes


@lower_builtin(magnitude, types.float64)
def _magnitude_of_number(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _intrinsic(builder, "fabs", args[0])


@lower_builtin(magnitude, Lanes)
def _magnitude(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _each(builder, lambda x: _intrinsic(builder, "fabs", x), args[0])


def _fold(builder: Any, lanes: Any, join: Callable[..., Any]) -> Any:
    """Join the lanes to one number: the two halves lane by lane, and so on."""
    width = WIDTH
    while width > 1:
        width //= 2
        order = [ir.Constant(ir.VectorType(INT32, width), [first + n for n in range(width)]) for first in (0, width)]
        undefined = ir.Constant(lanes.type, ir.Undefined)
        lanes = join(*(builder.shuffle_vector(lanes, undefined, half) for half in order))
    return builder.extract_element(lanes, INT32(0))


@type_callable(lane_sum)
def _type_sum(context: Any) -> Any:
    number = types.float64
    return lambda lanes: types.UniTuple(number, len(lanes)) if isinstance(lanes, types.UniTuple) else number


@type_callable(lane_maximum)
def _type_maximum(context: Any) -> Any:
    return lambda lanes: types.float64


@lower_builtin(lane_sum, Lanes)
def _sum(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _fold(builder, args[0], builder.fadd)


@lower_builtin(lane_sum, types.UniTuple)
def _sums(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    sums = [_fold(builder, lanes, builder.fadd) for lanes in cgutils.unpack_tuple(builder, args[0])]
    return context.make_tuple(builder, sig.return_type, sums)


@lower_builtin(lane_maximum, Lanes)
def _maximum(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _fold(builder, args[0], lambda a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))


@type_callable(math.sqrt)
def _type_sqrt(context: Any) -> Any:
    return lambda x: LANES if isinstance(x, Lanes) else None


@lower_builtin(math.sqrt, Lanes)
def _sqrt(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _each(builder, lambda x: _intrinsic(builder, "sqrt", x), args[0])
