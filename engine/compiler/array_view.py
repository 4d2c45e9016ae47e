"""Minimal array types for kernels: an address and a length.

Numba passes an array as seven values, and a scene has a hundred arrays: half of the generated code packed and unpacked
them. An `ArrayView1D` is two values, and its indices are not tested for negative ones, of which kernels have none. It
is valid only as long as its array. Views are indexed, sliced and have `.shape[0]` as arrays do, so that kernels take
either. An `ArrayView2D` is a two-dimensional array of two values, whose rows are one-dimensional views.

Without the trick ARRAY_VIEWS, a part of an array is an array.
"""

import operator
from collections.abc import Callable
from typing import Any

from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import lower_builtin, lower_getattr, models, register_model
from numba.np.arrayobj import make_array, populate_array

from engine.compiler.intrinsic import intrinsic
from engine.compiler.tricks import Trick, in_use

INDEX = types.intp
INDEX_PAIR = types.UniTuple(types.intp, 2)
INDEX_KINDS = types.Integer, types.IntEnumMember


class ArrayView1D(types.Type):
    """The Numba type of a view of numbers of one type, in one dimension."""

    def __init__(self, dtype: types.Type) -> None:
        self.dtype = dtype
        super().__init__(name=f"ArrayView1D({dtype})")


class ArrayView2D(types.Type):
    """The Numba type of a view of numbers of one type, in two dimensions."""

    def __init__(self, dtype: types.Type) -> None:
        self.dtype = dtype
        super().__init__(name=f"ArrayView2D({dtype})")


@register_model(ArrayView1D)
class _ArrayView1DModel(models.StructModel):
    def __init__(self, manager: Any, kind: ArrayView1D) -> None:
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)), ("size", INDEX)])


@register_model(ArrayView2D)
class _ArrayView2DModel(models.StructModel):
    def __init__(self, manager: Any, kind: ArrayView2D) -> None:
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)), ("columns", INDEX)])


def _unpack(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0])


def _make_view(context: Any, builder: Any, kind: ArrayView1D, data: Any, begin: Any, end: Any) -> Any:
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.data = builder.gep(data, [begin], inbounds=True)
    made.size = builder.sub(end, begin)
    return made._getvalue()


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        of, index = args
        if isinstance(of, ArrayView1D | ArrayView2D) and isinstance(index, INDEX_KINDS):
            return signature(of.dtype if isinstance(of, ArrayView1D) else ArrayView1D(of.dtype), of, INDEX)
        if isinstance(of, ArrayView1D) and isinstance(index, types.SliceType):
            return signature(of, of, types.slice2_type)
        if isinstance(of, ArrayView2D) and isinstance(index, types.BaseTuple):
            return signature(of.dtype, of, INDEX_PAIR)
        return None


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        of, index, _ = args
        if isinstance(of, ArrayView1D) and isinstance(index, INDEX_KINDS):
            return signature(types.none, of, INDEX, of.dtype)
        if isinstance(of, ArrayView2D) and isinstance(index, types.BaseTuple):
            return signature(types.none, of, INDEX_PAIR, of.dtype)
        return None


@infer_getattr
class _Shape(AttributeTemplate):
    key = ArrayView1D

    def resolve_shape(self, vector: ArrayView1D) -> Any:
        return types.UniTuple(INDEX, 1)


@lower_getattr(ArrayView1D, "shape")
def _shape(context: Any, builder: Any, kind: ArrayView1D, value: Any) -> Any:
    size = cgutils.create_struct_proxy(kind)(context, builder, value).size
    return context.make_tuple(builder, types.UniTuple(INDEX, 1), [size])


def _element_address(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the address of an element."""
    of, index = _unpack(context, builder, sig, args), args[1]
    if isinstance(index, int):
        index = context.get_constant(INDEX, index)
    elif isinstance(sig.args[0], ArrayView2D):
        row, column = cgutils.unpack_tuple(builder, index)
        index = builder.add(builder.mul(row, of.columns), column)
    return builder.gep(of.data, [index], inbounds=True)


@lower_builtin(operator.getitem, ArrayView1D, types.Integer)
@lower_builtin("static_getitem", ArrayView1D, types.IntegerLiteral)
@lower_builtin(operator.getitem, ArrayView2D, types.BaseTuple)
def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return context.unpack_value(builder, sig.args[0].dtype, _element_address(context, builder, sig, args))


@lower_builtin(operator.setitem, ArrayView1D, types.Integer, types.Any)
@lower_builtin("static_setitem", ArrayView1D, types.Integer, types.Any)
@lower_builtin(operator.setitem, ArrayView2D, types.BaseTuple, types.Any)
def _set(context: Any, builder: Any, sig: Any, args: Any) -> None:
    context.pack_value(builder, sig.args[0].dtype, args[2], _element_address(context, builder, sig, args))


@lower_builtin(operator.getitem, ArrayView1D, types.SliceType)
def _slice(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    part = context.make_helper(builder, sig.args[1], value=args[1])
    data = _unpack(context, builder, sig, args).data
    return _make_view(context, builder, sig.args[0], data, part.start, part.stop)


@lower_builtin(operator.getitem, ArrayView2D, types.Integer)
@lower_builtin("static_getitem", ArrayView2D, types.IntegerLiteral)
def _row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    of, row = _unpack(context, builder, sig, args), args[1]
    if isinstance(row, int):
        row = context.get_constant(INDEX, row)
    begin = builder.mul(row, of.columns)
    return _make_view(context, builder, sig.return_type, of.data, begin, builder.add(begin, of.columns))


AS_VIEWS = in_use(Trick.ARRAY_VIEWS, lambda: issubclass(models.StructModel, models.DataModel))


def _part_kind(kind: types.Array, dimensions: int) -> Any:
    """Return the type of a part of an array."""
    if not AS_VIEWS:
        return types.Array(kind.dtype, dimensions, "C")
    return ArrayView1D(kind.dtype) if dimensions == 1 else ArrayView2D(kind.dtype)


def _build_part(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any]) -> Any:
    """Return a part of an array, by its address and its shape. It holds no reference to the memory."""
    if not AS_VIEWS:
        made = make_array(kind)(context, builder)
        item_size = context.get_constant(INDEX, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
        strides = [item_size] if len(shape) == 1 else [builder.mul(shape[1], item_size), item_size]
        populate_array(made, data=data, shape=shape, strides=strides, itemsize=item_size, meminfo=None)
        return made._getvalue()
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.data = data
    if isinstance(kind, ArrayView1D):
        made.size = shape[0]
    else:
        made.columns = shape[1]
    return made._getvalue()


def _cut(array: Any, cut_dimensions: int, dimensions: int, numbers: Any, locate: Callable[..., Any]) -> Any:
    """Return the signature and the code of a part of an array; None for what is no contiguous array of so many
    dimensions. locate: returns the number of the part's first item, and its shape, from the builder, the array's shape
    and the numbers"""
    if not (isinstance(array, types.Array) and array.ndim == cut_dimensions and array.layout == "C"):
        return None

    def cut(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        of = _unpack(context, builder, sig, args)
        given = [context.cast(builder, x, kind, INDEX) for x, kind in zip(args[1:], sig.args[1:], strict=True)]
        first, shape = locate(builder, cgutils.unpack_tuple(builder, of.shape), *given)
        data = builder.gep(of.data, [first], inbounds=True)
        return _build_part(context, builder, sig.return_type, data, shape)

    return _part_kind(array, dimensions)(array, *numbers), cut


@intrinsic
def slice_view(array: Any, begin: Any, end: Any) -> Any:
    """Return items begin:end of a contiguous one-dimensional array."""
    return _cut(array, 1, 1, (begin, end), lambda builder, shape, begin, end: (begin, [builder.sub(end, begin)]))


@intrinsic
def matrix_view(array: Any, n: Any) -> Any:
    """Return matrix n of a contiguous three-dimensional array."""

    def locate(builder: Any, shape: Any, n: Any) -> Any:
        return builder.mul(n, builder.mul(shape[1], shape[2])), list(shape[1:])

    return _cut(array, 3, 2, (n,), locate)


@intrinsic
def column_view(array: Any, begin: Any) -> Any:
    """Return the columns of a contiguous two-dimensional array from `begin` on. Rows of the view reach beyond the end
    of the array's rows."""
    return _cut(array, 2, 2, (begin,), lambda builder, shape, begin: (begin, list(shape)))


@intrinsic
def row_view(array: Any, begin: Any) -> Any:
    """Return the rows of a contiguous two-dimensional array from `begin` on. The view does not know how many there
    are."""
    return _cut(array, 2, 2, (begin,), lambda builder, shape, begin: (builder.mul(begin, shape[1]), list(shape)))
