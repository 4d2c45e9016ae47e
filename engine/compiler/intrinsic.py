"""A decorator for functions whose code is written in LLVM's language."""

from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Any

from numba.core import types
from numba.extending import lower_builtin, type_callable


def intrinsic(define: Callable[..., Any]) -> Any:
    """Make a function of compiled code from one that takes the Numba types of its arguments, and returns the function's
    signature and what writes its code, given context, builder, signature and arguments; None for wrong types.

    numba.extending.intrinsic does the same, but makes Numba look through all its registries at every use: 1 s.
    """

    parameters = signature(define)

    @wraps(define)
    def function(*arguments: Any) -> Any:
        raise TypeError(f"{define.__name__} is for compiled code")

    @type_callable(function)
    def type_of(context: Any) -> Callable[..., Any]:
        def kind(*kinds: Any) -> Any:
            defined = define(*kinds)
            return None if defined is None else defined[0]

        kind.pysig = parameters  # type: ignore[attr-defined]
        return kind

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return define(*sig.args)[1](context, builder, sig, args)

    register: Any = lower_builtin
    register(function, *[types.Any] * len(parameters.parameters))(lower)
    return function
