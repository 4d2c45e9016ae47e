"""Eight numbers of double precision at a time, as vector code on any processor. In compiled code only.

`Lanes` are added, subtracted, multiplied and divided as numbers are, by each other or by a number. Each operation is
rounded as that of a single number, and sums are taken in a fixed order; so the bits do not depend on how wide the
vectors of the processor are, as those of sums that the compiler may reorder do.

Without the trick, the same is done number by number.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

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
    """The Numba type of eight numbers of double precision."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES = Lanes()
AS_VECTORS = in_use(Trick.LANES, lambda: str(VECTOR) == "<8 x double>")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, VECTOR)


def load_lanes(numbers: Any, k: int) -> Any:
    """Eight numbers of a contiguous array, of either precision, from number k on."""
    raise TypeError("load_lanes is for compiled code")


def store_lanes(numbers: Any, k: int, lanes: Any) -> None:
    """Write eight numbers to a contiguous array, from number k on."""
    raise TypeError("store_lanes is for compiled code")


def splat(x: float) -> Any:
    """The same number in each lane."""
    raise TypeError("splat is for compiled code")


def multiply_add(a: Any, b: Any, c: Any) -> Any:
    """a·b + c, rounded once. Numbers stand for the same in each lane."""
    raise TypeError("multiply_add is for compiled code")


def where_positive(test: Any, yes: Any, no: Any) -> Any:
    """`yes` in the lanes where `test` > 0, and `no` elsewhere. Numbers stand for the same in each lane."""
    raise TypeError("where_positive is for compiled code")


def greater(a: Any, b: Any) -> Any:
    """The greater of each two lanes; that of `b` where one is not a number."""
    raise TypeError("greater is for compiled code")


def magnitude(lanes: Any) -> Any:
    """The absolute value of each lane."""
    raise TypeError("magnitude is for compiled code")


def lane_sum(lanes: Any) -> float:
    """The sum of the lanes: of the two halves lane by lane, and so on."""
    raise TypeError("lane_sum is for compiled code")


# --- how they are compiled


def _constant(x: float) -> Any:
    return ir.Constant(VECTOR, [x] * WIDTH)


def _splat(builder: Any, x: Any) -> Any:
    undefined = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, x, INT32(0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(INT32, WIDTH), [0] * WIDTH))


def _as_lanes(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A value as lanes: that of a number is the same in each."""
    if isinstance(kind, Lanes):
        return value
    return _splat(builder, context.cast(builder, value, kind, types.float64))


def _each(builder: Any, operation: Callable[..., Any], *operands: Any) -> Any:
    """An operation on all lanes: at once, or without the trick one after the other."""
    if AS_VECTORS:
        return operation(*operands)
    made = ir.Constant(VECTOR, ir.Undefined)
    for lane in range(WIDTH):
        part = operation(*(builder.extract_element(x, INT32(lane)) for x in operands))
        made = builder.insert_element(made, part, INT32(lane))
    return made


def _intrinsic(builder: Any, name: str, *operands: Any) -> Any:
    """A function that LLVM knows, of numbers or of vectors."""
    kind = operands[0].type
    suffix = "v8f64" if isinstance(kind, ir.VectorType) else "f64"
    function = ir.FunctionType(kind, [kind] * len(operands))
    return builder.call(cgutils.get_or_insert_function(builder.module, function, f"llvm.{name}.{suffix}"), operands)


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
    """Let compiled code use an operator of Python on lanes."""
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


@type_callable(splat)
def _type_splat(context: Any) -> Any:
    return lambda x: LANES


@lower_builtin(splat, types.Number)
def _lower_splat(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _as_lanes(context, builder, sig.args[0], args[0])


@type_callable(multiply_add)
def _type_multiply_add(context: Any) -> Any:
    return lambda a, b, c: LANES


@lower_builtin(multiply_add, types.Any, types.Any, types.Any)
def _multiply_add(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    operands = [_as_lanes(context, builder, kind, x) for kind, x in zip(sig.args, args, strict=True)]
    return _each(builder, lambda *lanes: _intrinsic(builder, "fma", *lanes), *operands)


@type_callable(where_positive)
def _type_where(context: Any) -> Any:
    return lambda test, yes, no: LANES


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
    return lambda lanes: LANES


@lower_builtin(magnitude, Lanes)
def _magnitude(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _each(builder, lambda x: _intrinsic(builder, "fabs", x), args[0])


@type_callable(lane_sum)
def _type_sum(context: Any) -> Any:
    return lambda lanes: types.float64


@lower_builtin(lane_sum, Lanes)
def _sum(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    lanes, width = args[0], WIDTH
    while width > 1:
        width //= 2
        order = [ir.Constant(ir.VectorType(INT32, width), [first + n for n in range(width)]) for first in (0, width)]
        undefined = ir.Constant(lanes.type, ir.Undefined)
        lanes = builder.fadd(*(builder.shuffle_vector(lanes, undefined, half) for half in order))
    return builder.extract_element(lanes, INT32(0))


@type_callable(math.sqrt)
def _type_sqrt(context: Any) -> Any:
    return lambda x: LANES if isinstance(x, Lanes) else None


@lower_builtin(math.sqrt, Lanes)
def _sqrt(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _each(builder, lambda x: _intrinsic(builder, "sqrt", x), args[0])
