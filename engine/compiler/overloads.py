"""Functions whose compiled code is chosen, or generated, by the types of their arguments."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from numba.core import types
from numba.extending import overload


def overload_by_type(function: Callable[..., Any], implementations: Mapping[Any, Callable[..., Any]]) -> None:
    """Replace compiled calls of a function by calls of the implementation for the type of its first argument.

    implementations: by NamedTuple class, or `type(None)`; each has the arguments of the function
    """

    def choose(first: Any, *others: Any) -> Callable[..., Any] | None:
        kind = type(None) if is_none(first) else getattr(first, "instance_class", None)
        return implementations.get(kind) if kind is not None else None

    _overload_with(function, choose)


def overload_by_source(function: Callable[..., Any], write: Callable[..., tuple[str, Mapping[str, Any]]]) -> None:
    """Replace compiled calls of a function by an expression that is generated for the Numba types of its arguments.

    write: from these types to the source of the expression, in the names of the arguments, and the other names in it
    """
    parameters = ", ".join(inspect.signature(function).parameters)

    def choose(*kinds: Any) -> Callable[..., Any]:
        expression, names = write(*kinds)
        namespace = dict(names)
        exec(f"def written({parameters}):\n    return {expression}", namespace)
        written: Callable[..., Any] = namespace["written"]
        return written

    _overload_with(function, choose)


def _overload_with(function: Callable[..., Any], choose: Callable[..., Any]) -> None:
    """Replace compiled calls of a function by calls of the function that `choose` returns for the Numba types of its
    arguments."""

    def chosen(*kinds: Any) -> Any:
        return choose(*kinds)

    plain = [p.replace(annotation=inspect.Parameter.empty) for p in inspect.signature(function).parameters.values()]
    chosen.__signature__ = inspect.Signature(plain)  # type: ignore[attr-defined]
    overload(function)(chosen)


def is_none(kind: Any) -> bool:
    """True if a Numba type is that of None."""
    return isinstance(kind, types.NoneType)
