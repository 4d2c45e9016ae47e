"""The kind of a value, as compiled code has it: what its types are, in plain tuples and words.

Numba has types for the same, but takes a second to import; a kernel that is kept on disk is found and run without it.

    "int", "float", "bool"         a number
    None                           nothing
    ("f8", 2)                      an array: its numbers, as NumPy names them, and its dimensions
    ("module.Name", kind, …)       a NamedTuple
    ("tuple", kind, …)             a plain tuple
    ("pointer", kind, effects)     the address of such a value (engine.compiler.struct_handle); and of a Model the
                                   effects of the kernel that takes it (engine.compiler.special_kernels)
"""

import importlib
from typing import Any

import numpy as np

from engine.compiler.special_kernels import ALL

Kind = Any
INT, FLOAT, POINTER = "int", "float", "pointer"
NUMBERS: tuple[tuple[Any, str, Any], ...] = (
    ((bool, np.bool_), "bool", False),
    ((int, np.integer), INT, 0),
    ((float, np.floating), FLOAT, 0.0),
)


def kind_of(value: Any) -> Kind:
    """The kind of a value. Raises TypeError for one that compiled code has no kind for."""
    if isinstance(value, np.ndarray):
        return value.dtype.str[1:], value.ndim
    if value is None:
        return None
    if hasattr(value, "_fields"):
        record = type(value)
        return f"{record.__module__}.{record.__qualname__}", *map(kind_of, value)
    if type(value) is tuple:
        return "tuple", *map(kind_of, value)
    for classes, kind, _ in NUMBERS:
        if isinstance(value, classes):
            return kind
    raise TypeError(f"{type(value).__name__} has no kind")


def example_of(kind: Kind) -> Any:
    """A value of a kind: arrays of no items, and zeros."""
    if kind is None:
        return None
    if isinstance(kind, str):
        return next(example for _, name, example in NUMBERS if name == kind)
    name, *inner = kind
    if "." not in name:
        return np.zeros((0,) * inner[0], name)
    module, _, record = name.rpartition(".")
    return getattr(importlib.import_module(module), record)(*map(example_of, inner))


def as_kind(words: Any) -> Kind:
    """A kind that was written as JSON, which knows no tuples."""
    return tuple(map(as_kind, words)) if isinstance(words, list) else words


def effects_of(kinds: tuple[Kind, ...]) -> int:
    """The effects of the kernel that takes arguments of these kinds: those that a pointer names, or all."""
    pointers = [kind for kind in kinds if isinstance(kind, tuple) and kind[0] == POINTER]
    return next((effects for _, _, effects in pointers if effects != ALL), ALL)
