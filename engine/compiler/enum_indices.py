"""Let compiled code index arrays by members of enumerations, as in `ledger[row, Ledger.STORED]`. Numba does so
itself since version 0.66."""

import operator
from typing import Any

from numba.core import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature


def _as_integers(array: Any, index: Any) -> Any:
    """Return the Numba type of an index with its members of enumerations as integers; None if it has no such member."""
    kinds: Any = index.types if isinstance(index, types.UniTuple | types.Tuple) else [index]
    if not isinstance(array, types.Array) or not any(isinstance(kind, types.IntEnumMember) for kind in kinds):
        return None
    if not all(isinstance(kind, types.IntEnumMember | types.Integer) for kind in kinds):
        return None
    return types.UniTuple(types.intp, len(kinds)) if isinstance(index, types.BaseTuple) else types.intp


def _of_item(array: Any, integers: Any) -> Any:
    """Return the Numba type of an indexed item: a number, or a row of a matrix. None if it is neither."""
    count = integers.count if isinstance(integers, types.UniTuple) else 1
    if count == array.ndim:
        return array.dtype
    is_row = count == 1 and array.ndim == 2 and array.layout == "C"
    return types.Array(array.dtype, 1, "C") if is_row else None


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        array, index = args
        integers = _as_integers(array, index)
        item = None if integers is None else _of_item(array, integers)
        return None if item is None else signature(item, array, integers)


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        array, index, _ = args
        integers = _as_integers(array, index)
        is_item = integers is not None and _of_item(array, integers) is array.dtype
        return signature(types.none, array, integers, array.dtype) if is_item else None
