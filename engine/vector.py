"""A one-dimensional array within a kernel, at its barest: where it is, and how long.

Numba hands an array on as seven values, and a scene has a hundred arrays: half of the code it made was
packing and unpacking. A `Vector` is two values, and its indices are not tested for negative ones, of
which kernels have none. `view` makes one of a part of an array, and lives no longer than that array.
Vectors are indexed, sliced and asked for `.shape[0]` as arrays are, so that kernels take either. A `Matrix`
is a two-dimensional array of three, whose rows are vectors.
"""

import operator
from typing import Any

from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import lower_builtin, lower_getattr, models, register_model, type_callable

INDEX = types.intp
CELL = types.UniTuple(types.intp, 2)


class Vector(types.Type):
    """The Numba type of a vector of numbers of one type."""

    def __init__(self, dtype: types.Type) -> None:
        self.dtype = dtype
        super().__init__(name=f"Vector({dtype})")


class Matrix(types.Type):
    """The Numba type of a matrix of numbers of one type."""

    def __init__(self, dtype: types.Type) -> None:
        self.dtype = dtype
        super().__init__(name=f"Matrix({dtype})")


@register_model(Vector)
class _VectorModel(models.StructModel):
    def __init__(self, manager: Any, kind: Vector) -> None:
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)), ("size", INDEX)])


@register_model(Matrix)
class _MatrixModel(models.StructModel):
    def __init__(self, manager: Any, kind: Matrix) -> None:
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)), ("columns", INDEX)])


def view(array: Any, begin: int, end: int) -> Any:
    """Items begin:end of a contiguous array of one dimension, as a Vector; in compiled code only."""
    raise TypeError("view is for compiled code")


def matrix(array: Any, n: int) -> Any:
    """Matrix n of a contiguous array of three dimensions; in compiled code only."""
    raise TypeError("matrix is for compiled code")


def columns(array: Any, begin: int) -> Any:
    """The columns of a contiguous array of two dimensions from `begin` on, as a Matrix whose rows run over their
    end; in compiled code only."""
    raise TypeError("columns is for compiled code")


# An @intrinsic would do for these, but makes Numba look through all its registries at every use: 1 s.


@type_callable(view)
def _type_view(context: Any) -> Any:
    def kind(array: Any, begin: Any, end: Any) -> Vector | None:
        flat = isinstance(array, types.Array) and array.ndim == 1 and array.layout == "C"
        return Vector(array.dtype) if flat else None

    return kind


@lower_builtin(view, types.Array, types.Integer, types.Integer)
def _view(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    begin, end = (context.cast(builder, args[n], sig.args[n], INDEX) for n in (1, 2))
    return _part(context, builder, sig.return_type, _unpacked(context, builder, sig, args).data, begin, end)


@type_callable(matrix)
def _type_matrix(context: Any) -> Any:
    def kind(array: Any, n: Any) -> Matrix | None:
        deep = isinstance(array, types.Array) and array.ndim == 3 and array.layout == "C"
        return Matrix(array.dtype) if deep else None

    return kind


@lower_builtin(matrix, types.Array, types.Integer)
def _matrix(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array = _unpacked(context, builder, sig, args)
    n = context.cast(builder, args[1], sig.args[1], INDEX)
    _, rows, columns = cgutils.unpack_tuple(builder, array.shape)
    made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    made.data = builder.gep(array.data, [builder.mul(n, builder.mul(rows, columns))], inbounds=True)
    made.columns = columns
    return made._getvalue()


@type_callable(columns)
def _type_columns(context: Any) -> Any:
    def kind(array: Any, begin: Any) -> Matrix | None:
        wide = isinstance(array, types.Array) and array.ndim == 2 and array.layout == "C"
        return Matrix(array.dtype) if wide else None

    return kind


@lower_builtin(columns, types.Array, types.Integer)
def _columns(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array = _unpacked(context, builder, sig, args)
    begin = context.cast(builder, args[1], sig.args[1], INDEX)
    made = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    made.data = builder.gep(array.data, [begin], inbounds=True)
    made.columns = cgutils.unpack_tuple(builder, array.shape)[1]
    return made._getvalue()


def _unpacked(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return cgutils.create_struct_proxy(sig.args[0])(context, builder, args[0])


def _part(context: Any, builder: Any, kind: Vector, data: Any, begin: Any, end: Any) -> Any:
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.data = builder.gep(data, [begin], inbounds=True)
    made.size = builder.sub(end, begin)
    return made._getvalue()


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        of, index = args
        if isinstance(of, Vector | Matrix) and isinstance(index, types.Integer):
            return signature(of.dtype if isinstance(of, Vector) else Vector(of.dtype), of, INDEX)
        if isinstance(of, Vector) and isinstance(index, types.SliceType):
            return signature(of, of, types.slice2_type)
        if isinstance(of, Matrix) and isinstance(index, types.BaseTuple):
            return signature(of.dtype, of, CELL)
        return None


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        of, index, _ = args
        if isinstance(of, Vector) and isinstance(index, types.Integer):
            return signature(types.none, of, INDEX, of.dtype)
        if isinstance(of, Matrix) and isinstance(index, types.BaseTuple):
            return signature(types.none, of, CELL, of.dtype)
        return None


@infer_getattr
class _Shape(AttributeTemplate):
    key = Vector

    def resolve_shape(self, vector: Vector) -> Any:
        return types.UniTuple(INDEX, 1)


@lower_getattr(Vector, "shape")
def _shape(context: Any, builder: Any, kind: Vector, value: Any) -> Any:
    size = cgutils.create_struct_proxy(kind)(context, builder, value).size
    return context.make_tuple(builder, types.UniTuple(INDEX, 1), [size])


def _place(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Address of an element."""
    of, index = _unpacked(context, builder, sig, args), args[1]
    if isinstance(index, int):
        index = context.get_constant(INDEX, index)
    elif isinstance(sig.args[0], Matrix):
        row, column = cgutils.unpack_tuple(builder, index)
        index = builder.add(builder.mul(row, of.columns), column)
    return builder.gep(of.data, [index], inbounds=True)


@lower_builtin(operator.getitem, Vector, types.Integer)
@lower_builtin("static_getitem", Vector, types.IntegerLiteral)
@lower_builtin(operator.getitem, Matrix, types.BaseTuple)
def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return context.unpack_value(builder, sig.args[0].dtype, _place(context, builder, sig, args))


@lower_builtin(operator.setitem, Vector, types.Integer, types.Any)
@lower_builtin("static_setitem", Vector, types.Integer, types.Any)
@lower_builtin(operator.setitem, Matrix, types.BaseTuple, types.Any)
def _set(context: Any, builder: Any, sig: Any, args: Any) -> None:
    context.pack_value(builder, sig.args[0].dtype, args[2], _place(context, builder, sig, args))


@lower_builtin(operator.getitem, Vector, types.SliceType)
def _slice(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    part = context.make_helper(builder, sig.args[1], value=args[1])
    data = _unpacked(context, builder, sig, args).data
    return _part(context, builder, sig.args[0], data, part.start, part.stop)


@lower_builtin(operator.getitem, Matrix, types.Integer)
@lower_builtin("static_getitem", Matrix, types.IntegerLiteral)
def _row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    of, row = _unpacked(context, builder, sig, args), args[1]
    if isinstance(row, int):
        row = context.get_constant(INDEX, row)
    begin = builder.mul(row, of.columns)
    return _part(context, builder, sig.return_type, of.data, begin, builder.add(begin, of.columns))
