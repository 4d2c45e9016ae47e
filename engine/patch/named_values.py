"""Named values of a patch, in [values], and formulas of them anywhere else: of one radius follow a mass, an inertia and
a pitch."""

import ast
import math
import re
from collections.abc import Callable, Iterator
from typing import Any

from pydantic_core import InitErrorDetails

from engine.bodies.table import KeyPath, is_number, make_fault
from engine.instrument.expansion import is_instrument
from engine.instrument.formula import FUNCTIONS, FormulaError, evaluate, is_formula, parse
from engine.wording import to_one_line

CONSTANTS = {"pi": math.pi}  # that formulas know beside the values
UNITS = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "µm": 1e-6,
    "in": 0.0254,
    "kg": 1.0,
    "g": 1e-3,
    "mg": 1e-6,
    "s": 1.0,
    "ms": 1e-3,
    "Hz": 1.0,
    "kHz": 1e3,
    "N": 1.0,
    "J": 1.0,
    "Pa": 1.0,
    "kPa": 1e3,
    "MPa": 1e6,
    "GPa": 1e9,
    "kg/m3": 1.0,
    "g/cm3": 1e3,
    "kg/m³": 1.0,
    "g/cm³": 1e3,
    "m/s": 1.0,
    "cm/s": 1e-2,
    "km/h": 1 / 3.6,
    "N/m": 1.0,
    "rad": 1.0,
    "deg": math.pi / 180,
    "%": 1e-2,
}
QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S+)")
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
VALUES, VARY = "values", "vary"
TEXTS = ("title", "author", "licence", "labels", VALUES, VARY)  # of a patch, where no formula is looked for
MAX_SHOWN = 60

Faults = list[InitErrorDetails]


def fill_in_values(data: dict[str, Any]) -> tuple[dict[str, Any], Faults]:
    """Return a document with numbers in place of its formulas, and the faults of its values and formulas. An instrument
    has its values in its keyboard, whose formulas are read for each key."""
    given = data.get(VALUES)
    if is_instrument(data):
        keyboard = data.get("keyboard")
        if isinstance(given, dict) and isinstance(keyboard, dict):
            data = {name: table for name, table in data.items() if name != VALUES}
            data["keyboard"] = keyboard | {VALUES: given | (keyboard.get(VALUES) or {})}
        return data, []
    if given is not None and not isinstance(given, dict):
        return data, []  # which is no table, as validation says
    named = NamedValues(given or {})
    rest = {key: part if key in TEXTS else named.fill_in(part, (key,)) for key, part in data.items()}
    return rest, named.faults


class NamedValues:
    """The values of a patch by their names, whatever their order, and the faults of those that have none."""

    def __init__(self, given: dict[str, Any]) -> None:
        self.given, self.faults = given, Faults()
        self.numbers: dict[str, float] = dict(CONSTANTS)
        self._wrong: set[str] = set()  # names without a number, of which a fault is kept
        for name in given:
            self._find(name, ())

    def fill_in(self, part: Any, path: KeyPath) -> Any:
        """Return a part of the document with numbers in place of formulas; a formula that has no value stays."""
        if isinstance(part, dict):
            return {key: inner if key == "name" else self.fill_in(inner, (*path, key)) for key, inner in part.items()}
        if isinstance(part, list):
            return [self.fill_in(inner, (*path, n)) for n, inner in enumerate(part)]
        if not is_formula(part):
            return part
        number = self._evaluate(part, path)
        return 0 if number is None else number

    def _find(self, name: str, users: tuple[str, ...]) -> None:
        """Find the number of a name, and those that it needs. users: of which it is to be found"""
        if name in self._wrong or (name in self.numbers and name not in CONSTANTS):
            return
        value, path = self.given[name], (VALUES, name)
        if not NAME.fullmatch(name) or name in FUNCTIONS or name in CONSTANTS:
            remedy = f"use letters, digits and _, and no name of a function, nor {' or '.join(CONSTANTS)}"
            self._refuse(name, make_fault(path, value, f'"{name}" cannot be the name of a value', remedy))
        elif name in users:
            circle = " → ".join([*users[users.index(name) :], name])
            message = f"it depends on itself: {circle}"
            self._refuse(name, make_fault(path, value, message, "give one of them a number"))
        elif is_formula(value):
            for needed in _names_in(value):
                if needed in self.given and needed not in self._wrong:
                    self._find(needed, (*users, name))
            number = None if name in self._wrong else self._evaluate(value, path)
            self._keep(name, number)
        elif is_number(value) and math.isfinite(value):
            self.numbers[name] = float(value)
        else:
            self._keep(name, _read_quantity(value, lambda text: self._refuse(name, _quantity_fault(path, value, text))))

    def _keep(self, name: str, number: float | None) -> None:
        if number is None:
            self._wrong.add(name)
        else:
            self.numbers[name] = float(number)

    def _refuse(self, name: str, fault: InitErrorDetails) -> None:
        self._wrong.add(name)
        self.faults.append(fault)

    def _evaluate(self, formula: str, path: KeyPath) -> float | None:
        """Return the value of a formula; None if it has none, and a fault that says why, but where it wants a name that
        has a fault of its own."""
        try:
            return evaluate(formula, self.numbers)
        except FormulaError as error:
            if not self._wrong.intersection(_names_in(formula)):
                message, _, remedy = str(error).partition("; ")
                self.faults.append(make_fault(path, formula, message, remedy or "a formula that has a value"))
            return None


def _names_in(formula: str) -> Iterator[str]:
    """Yield the names in a formula; none of a wrong one."""
    try:
        tree = parse(formula)
    except FormulaError:
        return
    functions = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and id(node) not in functions:
            yield node.id


def _read_quantity(value: Any, refuse: Callable[[str], None]) -> float | None:
    """Return a number with a unit, such as "6 cm", in SI units."""
    quantity = QUANTITY.fullmatch(value.strip()) if isinstance(value, str) else None
    if quantity is None:
        refuse("not a number, a number with a unit, or a formula")
    elif quantity[2] not in UNITS:
        refuse(f'unknown unit "{to_one_line(quantity[2], MAX_SHOWN)}"')
    else:
        return float(quantity[1]) * UNITS[quantity[2]]
    return None


def _quantity_fault(path: KeyPath, value: Any, message: str) -> InitErrorDetails:
    return make_fault(path, value, message, f'such as 0.06, "6 cm" or "= 2*radius"; units are {", ".join(UNITS)}')
