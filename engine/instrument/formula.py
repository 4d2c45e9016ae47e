"""Formulas of a patch: texts such as "= 4.5e9 * exp(0.06*n)", evaluated by simpleeval, which knows numbers only."""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from simpleeval import SimpleEval

MAX_CHARACTERS = 500
FORMULA_MARK = "="
MAX_WHOLE = 1e9  # up to which whole values are whole numbers, as counts have to be


class FormulaError(ValueError):
    """A formula that has no value."""


def cents(x: float) -> float:
    """The ratio of frequencies that so many cents are."""
    return float(2.0 ** (x / 1200.0))


def pick(i: float, *values: float) -> float:
    """Value number i of some, from 1; the last beyond. Raises FormulaError if i is below 1."""
    if i < 1 or not values:
        raise FormulaError(f"pick({i:g}, …) has no such value; values count from 1")
    return values[min(int(i), len(values)) - 1]


FUNCTIONS: dict[str, Callable[..., float]] = {
    **{name: getattr(math, name) for name in ("exp", "log", "log10", "sqrt", "sin", "cos", "floor", "ceil")},
    "abs": abs,
    "min": min,
    "max": max,
    "round": round,
    "cents": cents,
    "pick": pick,
}
OPERATORS: dict[type, Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.FloorDiv: operator.floordiv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Pow: lambda x, y: math.pow(x, y),
}


def is_formula(value: Any) -> bool:
    """Whether a value of a patch is a formula."""
    return isinstance(value, str) and value.lstrip().startswith(FORMULA_MARK)


def evaluate(formula: str, names: Mapping[str, float]) -> float:
    """The value of a formula, given those of the names in it. Raises FormulaError."""
    text = formula.strip().removeprefix(FORMULA_MARK).strip()
    evaluator = SimpleEval(operators=OPERATORS, functions=FUNCTIONS, names=dict(names))
    try:
        value = evaluator.eval(text, previously_parsed=_parse(text))
    except FormulaError:
        raise
    except Exception as error:  # simpleeval raises errors of its own, and whatever the arithmetic raises
        raise FormulaError(_describe(error, names)) from None
    if isinstance(value, bool):
        return float(value)
    if not isinstance(value, int | float):
        raise FormulaError("it is not a number")
    if not math.isfinite(value):
        raise FormulaError(f"it is {value}")
    return int(value) if value == int(value) and abs(value) < MAX_WHOLE else float(value)


@lru_cache(4096)
def _parse(text: str) -> Any:
    """The parsed text of a formula. Raises FormulaError."""
    if len(text) > MAX_CHARACTERS:
        raise FormulaError(f"it has {len(text)} characters; at most {MAX_CHARACTERS}")
    try:
        return SimpleEval.parse(text)
    except Exception:
        raise FormulaError("it is not an arithmetic expression; use numbers, names, + - * / ** and functions") from None


def _describe(error: Exception, names: Mapping[str, float]) -> str:
    """What is wrong with a formula."""
    name = getattr(error, "name", None) or getattr(error, "func_name", None)
    if getattr(error, "func_name", None):
        return f"unknown function {name}; the functions are {', '.join(FUNCTIONS)}"
    if isinstance(name, str):
        return f"unknown name {name}; the names are {', '.join(names)}"
    return f"it has no value ({' '.join(str(error).split())[:120] or type(error).__name__})"
