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
from numba.extending import lower_builtin, lower_getattr, models, register_model, type_callable
from numba.np.arrayobj import make_array, populate_array

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


def slice_view(array: Any, begin: int, end: int) -> Any:
    """Return items begin:end of a contiguous one-dimensional array; in compiled code only."""
    raise TypeError("slice_view is for compiled code")


def matrix_view(array: Any, n: int) -> Any:
    """Return matrix n of a contiguous three-dimensional array; in compiled code only."""
    raise TypeError("matrix_view is for compiled code")


def column_view(array: Any, begin: int) -> Any:
    """Return the columns of a contiguous two-dimensional array from `begin` on; in compiled code only. Rows of the view
    reach beyond the end of the array's rows."""
    raise TypeError("column_view is for compiled code")


def row_view(array: Any, begin: int) -> Any:
    """Return the rows of a contiguous two-dimensional array from `begin` on; in compiled code only. The view does not
    know how many there are."""
    raise TypeError("row_view is for compiled code")


# An @intrinsic would do for these, but makes Numba look through all its registries at every use: 1 s.


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


def _as_view(kind: types.Array, dimensions: int) -> Any:
    return ArrayView1D(kind.dtype) if dimensions == 1 else ArrayView2D(kind.dtype)


def _as_array(kind: types.Array, dimensions: int) -> Any:
    return types.Array(kind.dtype, dimensions, "C")


def _build_view(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any]) -> Any:
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.data = data
    if isinstance(kind, ArrayView1D):
        made.size = shape[0]
    else:
        made.columns = shape[1]
    return made._getvalue()


def _build_array(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any]) -> Any:
    """Return a NumPy array that holds no reference to the memory that it is a part of."""
    made = make_array(kind)(context, builder)
    item_size = context.get_constant(INDEX, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides = [item_size] if len(shape) == 1 else [builder.mul(shape[1], item_size), item_size]
    populate_array(made, data=data, shape=shape, strides=strides, itemsize=item_size, meminfo=None)
    return made._getvalue()


def _let_kernels_cut(result_kind: Callable[..., Any], build: Callable[..., Any]) -> None:
    """Let compiled code take parts of arrays: slices, matrices, columns and rows.

    result_kind: returns the type of a part, from the type of an array and a number of dimensions
    build:       returns a value of that type, from an address and a shape
    """

    def typed(cut_dimensions: int, dimensions: int) -> Callable[..., Any]:
        def kind(array: Any, *numbers: Any) -> Any:
            fits = isinstance(array, types.Array) and array.ndim == cut_dimensions and array.layout == "C"
            return result_kind(array, dimensions) if fits else None

        return kind

    @type_callable(slice_view)
    def type_slice(context: Any) -> Any:
        kind = typed(1, 1)
        return lambda array, begin, end: kind(array)

    @lower_builtin(slice_view, types.Array, types.Integer, types.Integer)
    def lower_slice(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        begin, end = (context.cast(builder, args[n], sig.args[n], INDEX) for n in (1, 2))
        data = builder.gep(_unpack(context, builder, sig, args).data, [begin], inbounds=True)
        return build(context, builder, sig.return_type, data, [builder.sub(end, begin)])

    @type_callable(matrix_view)
    def type_matrix(context: Any) -> Any:
        kind = typed(3, 2)
        return lambda array, n: kind(array)

    @lower_builtin(matrix_view, types.Array, types.Integer)
    def lower_matrix(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array = _unpack(context, builder, sig, args)
        n = context.cast(builder, args[1], sig.args[1], INDEX)
        _, rows, columns = cgutils.unpack_tuple(builder, array.shape)
        data = builder.gep(array.data, [builder.mul(n, builder.mul(rows, columns))], inbounds=True)
        return build(context, builder, sig.return_type, data, [rows, columns])

    @type_callable(column_view)
    def type_columns(context: Any) -> Any:
        kind = typed(2, 2)
        return lambda array, begin: kind(array)

    @lower_builtin(column_view, types.Array, types.Integer)
    def lower_columns(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array = _unpack(context, builder, sig, args)
        begin = context.cast(builder, args[1], sig.args[1], INDEX)
        data = builder.gep(array.data, [begin], inbounds=True)
        return build(context, builder, sig.return_type, data, cgutils.unpack_tuple(builder, array.shape))

    @type_callable(row_view)
    def type_rows(context: Any) -> Any:
        kind = typed(2, 2)
        return lambda array, begin: kind(array)

    @lower_builtin(row_view, types.Array, types.Integer)
    def lower_rows(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array = _unpack(context, builder, sig, args)
        begin = context.cast(builder, args[1], sig.args[1], INDEX)
        rows, columns = cgutils.unpack_tuple(builder, array.shape)
        data = builder.gep(array.data, [builder.mul(begin, columns)], inbounds=True)
        return build(context, builder, sig.return_type, data, [rows, columns])


if in_use(Trick.ARRAY_VIEWS, lambda: issubclass(models.StructModel, models.DataModel)):
    _let_kernels_cut(_as_view, _build_view)
else:
    _let_kernels_cut(_as_array, _build_array)
