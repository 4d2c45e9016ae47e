"""Formulas of a patch: texts such as "= 4.5e9 * exp(0.06*n)".

What is not arithmetic is refused when a formula is parsed; simpleeval evaluates the rest in floating point, where no
number grows in memory.
"""

import ast
import math
import operator
import warnings
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from simpleeval import NameNotDefined, SimpleEval

from engine.arithmetic.plain_numbers import cos, exp, log, log10, power, sin
from engine.wording import to_one_line

MAX_CHARACTERS = 500
MAX_SHOWN = 60  # characters of a wrong part in a message
MAX_DEPTH = 100  # of operations inside operations; a sum of so many terms is as deep
FORMULA_MARK = "="
MAX_WHOLE = 1e9  # up to which whole values are whole numbers, as counts have to be


class FormulaError(ValueError):
    """A formula that has no value."""


def cents(x: float) -> float:
    """The ratio of frequencies that so many cents are."""
    return power(2.0, x / 1200.0)


def pick(i: float, *values: float) -> float:
    """Value number i of some, from 1; the last beyond. Raises FormulaError if i is below 1."""
    if i < 1 or not values:
        raise FormulaError(f"pick({i:g}, …) has no such value; values count from 1")
    return values[min(int(i), len(values)) - 1]


def logarithm(x: float, base: float | None = None) -> float:
    """The logarithm of x, natural if no base is given."""
    return log(x) if base is None else log(x) / log(base)


def round_number(x: float, digits: float = 0.0) -> float:
    """The nearest number with so many digits after the point; of two, the one whose last digit is even."""
    return round(x, int(digits))


FUNCTIONS: dict[str, Callable[..., float]] = {
    "exp": exp,
    "log": logarithm,
    "log10": log10,
    "sqrt": math.sqrt,
    "sin": sin,
    "cos": cos,
    "floor": lambda x: float(math.floor(x)),
    "ceil": lambda x: float(math.ceil(x)),
    "abs": abs,
    "min": lambda *values: min(values),
    "max": lambda *values: max(values),
    "round": round_number,
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
    ast.Pow: power,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: lambda x: float(not x),
    ast.Lt: lambda x, y: float(x < y),
    ast.LtE: lambda x, y: float(x <= y),
    ast.Gt: lambda x, y: float(x > y),
    ast.GtE: lambda x, y: float(x >= y),
    ast.Eq: lambda x, y: float(x == y),
    ast.NotEq: lambda x, y: float(x != y),
}
COMPOUNDS = ast.BinOp, ast.UnaryOp, ast.Compare, ast.BoolOp, ast.IfExp, ast.Name
SYMBOLS = *OPERATORS, ast.And, ast.Or, ast.Load
REMEDY = "use numbers, names, + - * / // % **, comparisons and functions"


def is_formula(value: Any) -> bool:
    """True if a value of a patch is a formula."""
    return isinstance(value, str) and value.lstrip().startswith(FORMULA_MARK)


def evaluate(formula: str, names: Mapping[str, float]) -> float:
    """The value of a formula, given those of the names in it. Raises FormulaError."""
    expression = parse(formula)
    numbers = {name: float(value) for name, value in names.items()}
    evaluator = SimpleEval(operators=OPERATORS, functions=FUNCTIONS, names=numbers)
    try:
        value = float(evaluator.eval(formula, previously_parsed=expression))
    except FormulaError:
        raise
    except Exception as error:  # simpleeval raises errors of its own, and whatever the arithmetic raises
        raise FormulaError(_describe(error, names)) from None
    if not math.isfinite(value):
        raise FormulaError(f"it is {value}")
    return int(value) if value == int(value) and abs(value) < MAX_WHOLE else value


@lru_cache(4096)
def parse(formula: str) -> ast.expr:
    """The expression of a formula, its numbers in floating point. Raises FormulaError if that is not arithmetic."""
    text = formula.strip().removeprefix(FORMULA_MARK).strip()
    if len(text) > MAX_CHARACTERS:
        raise FormulaError(f"it has {len(text)} characters; at most {MAX_CHARACTERS}")
    try:
        with warnings.catch_warnings(action="ignore"):  # of a style of writing that is refused or harmless
            expression = ast.parse(text, mode="eval").body
    except Exception:  # the parser raises one error for syntax, others for characters and for too many brackets
        raise FormulaError(f"it is not an arithmetic expression; {REMEDY}") from None
    level: list[ast.AST] = [expression]
    for _ in range(MAX_DEPTH):
        level = [inner for node in level for inner in _parts(node, text)]
    if level:
        raise FormulaError(f"it is nested too deeply; at most {MAX_DEPTH} operations inside each other")
    return expression


def _parts(node: ast.AST, text: str) -> list[ast.AST]:
    """List the nodes within an expression; a number becomes one in floating point. Raises FormulaError if the
    expression is not arithmetic. text: of the formula"""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        node.value = _to_float(node.value)
        return []
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id not in FUNCTIONS:
            name = to_one_line(node.func.id, MAX_SHOWN)
            raise FormulaError(f"unknown function {name}; the functions are {', '.join(FUNCTIONS)}")
        return [*node.args, *node.keywords]
    if isinstance(node, ast.Name) and node.id in FUNCTIONS:
        raise FormulaError(f"{node.id} is a function; give its arguments, as in {node.id}(n)")
    if not isinstance(node, COMPOUNDS + SYMBOLS):
        part = ast.get_source_segment(text, node) or text  # a symbol alone has no place in the text
        raise FormulaError(f"{to_one_line(part, MAX_SHOWN)} is not arithmetic; {REMEDY}")
    return list(ast.iter_child_nodes(node))


def _to_float(number: float) -> float:
    """A number of a formula in floating point. Raises FormulaError if it is beyond its range."""
    try:
        value = float(number)
    except OverflowError:
        value = math.inf
    if value == math.inf:
        raise FormulaError("it has a number that is too large; at most 1e308")
    return value


def _describe(error: Exception, names: Mapping[str, float]) -> str:
    """Describe the error of a formula."""
    if isinstance(error, NameNotDefined):
        return f"unknown name {to_one_line(error.name, MAX_SHOWN)}; the names are {', '.join(names)}"
    if isinstance(error, TypeError):
        return "a function has the wrong number of arguments"
    return f"it has no value ({' '.join(str(error).split())[:120] or type(error).__name__})"
