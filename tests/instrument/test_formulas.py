"""Formulas of a patch: arithmetic of numbers, and nothing else; none takes time or memory, whatever is in it."""

import gc
import math
import random
import re
import time
import tracemalloc

import pytest

import engine
from engine.instrument.formula import FUNCTIONS, FormulaError, evaluate

NAMES = {"f": 261.6, "n": 40.0, "v": 0.5, "i": 1.0}
PATCH = """
[keyboard]
keys = "C3..C5"

[[key.body]]
name = "string"
kind = "string"
length = 0.6
mass = 0.003
frequency = "= FORMULA"
modes = 4

[[key.body]]
name = "weight"
kind = "mass"
keys = "C5"
mass = "= OTHER"

[[key.pickup]]
body = "string"
at = 0.3

[[note]]
time = 0.0
key = "C4"
"""


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("= f", 261.6),
        ("= 2**3**2 - -1", 513),
        ("= 7 // 2 + 7 % 4", 6),
        ("= round(2.345, 2) + round(2.5) + floor(2.9) + ceil(2.1)", 9.35),
        ("= max(v, 0.2, min(v, 1)) + abs(-1) + sqrt(4) + log10(100) + log(exp(1))", 6.5),
        ("= cents(1200) * pick(i + 1, 5, 6, 7)", 12),
        ("= (v > 0.3) * (i == 1) + (1 < n <= 40)", 2),
        ("= 1 if v > 0.7 and i == 1 else 2 if not v > 0.7 or i > 3 else 3", 2),
        ("= 0x10 + 1_000 + 1e3", 2016),
        ("= " + "+".join(["1"] * 100), 100),
    ],
)
def test_arithmetic_has_its_value(formula, value):
    assert evaluate(formula, NAMES) == pytest.approx(value, rel=1e-12)


def test_a_whole_value_is_a_whole_number_as_counts_have_to_be():
    assert type(evaluate("= floor(min(40, 9000/f))", NAMES)) is int
    assert type(evaluate("= 10**12", NAMES)) is float


NOT_ARITHMETIC = [
    '("a"*1500000000).count("b")',
    '"%2000000000d" % 1',
    'f"{1:2000000000d}"',
    "'a'*1500000000 == 'b'",
    'b"a"*1500000000',
    "[0]*1500000000 == 1",
    "(0,)*1500000000 == 1",
    "{1} == 1",
    "[1 for i in f]",
    "f[0]",
    "f.real",
    "(1).real",
    "f.real.__class__",
    "1 << 10000000000",
    "f ^ 2",
    "f | 1",
    "f & 1",
    "~1",
    "f @ f",
    "f is f",
    "f in f",
    "(x := 3)",
    "lambda: 1",
    "await f",
    "max(*f)",
    "max(1, key=f)",
    "max(**f)",
    "max(1)(2)",
    "True",
    "None",
    "...",
    "1j",
]


@pytest.mark.parametrize("formula", NOT_ARITHMETIC)
def test_what_is_not_arithmetic_is_refused_before_it_is_evaluated(formula):
    with pytest.raises(FormulaError, match="is not arithmetic; use numbers, names, "):
        evaluate(f"= {formula}", NAMES)


@pytest.mark.parametrize(
    "formula", ["f; 1", "f\n1", "", "import os", "f = 1", "f +", "yield 1", "f\0", "\ud800", "(" * 490]
)
def test_what_is_not_one_expression_is_refused(formula):
    with pytest.raises(FormulaError, match="it is not an arithmetic expression; use numbers, names, "):
        evaluate(f"= {formula}", NAMES)


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("9" * 400, "a number that is too large; at most 1e308"),
        ("1e999", "a number that is too large; at most 1e308"),
        ("1" * 600, "it has 600 characters; at most 500"),
        ("-" * 480 + "1", "it is nested too deeply; at most 100 operations"),
        ("+".join(["1"] * 101), "it is nested too deeply; at most 100 operations"),
        ("int('9'*400)", "unknown function int; the functions are exp, "),
        ("f(1)", "unknown function f; the functions are exp, "),
        ("a" * 499, r"unknown name a+\.\.\.; the names are f, n, v, i"),
        ("10**10**10", "it has no value"),
        ("9**9**9**9**9", "it has no value"),
        ("floor(1e308) * floor(1e308)", "it is inf"),
        ("exp", "exp is a function"),
        ("pick(1, exp)", "exp is a function"),
        ("round(1, 1e308)", "1"),
    ],
)
def test_sizes_are_bounded(formula, says):
    try:
        value = str(evaluate(f"= {formula}", NAMES))
    except FormulaError as error:
        value = str(error)
    assert re.search(says, value)


def test_no_formula_takes_time_or_memory():
    """Those above, and random ones made of all that Python's expressions are made of: each has a finite value, or is
    refused, in milliseconds and kilobytes."""
    chance = random.Random(0)
    tokens = [
        *"fn9()(),.+-*/%<>~^|@:=#;[]{}\\\nπｆ",
        "1e300",
        "9" * 30,
        "//",
        "**",
        "<<",
        ">=",
        " if ",
        " else ",
        " and ",
        " not ",
    ]
    tokens += ['"a"', "'%99999999d'", "f'{f:99999999d}'", ".count", ".real", *(f"{name}(" for name in FUNCTIONS)]
    formulas = ["".join(chance.choices(tokens, k=chance.randint(1, 60))) for _ in range(1000)]
    for _ in range(300):  # of good syntax
        parts = chance.choices(["9", "f", "exp(9)", "floor(1e30)", "(1/9)"], k=chance.randint(1, 40))
        formulas.append("".join(part + chance.choice(["*", "+", "-", "/", "//", "**"]) for part in parts) + "2")
    refused, slowest = 0, 0.0
    gc.collect()
    gc.disable()  # a collection of all that other tests left takes longer than a formula
    tracemalloc.start()
    try:
        for formula in [*formulas, *NOT_ARITHMETIC]:
            begin = time.thread_time()
            try:
                assert math.isfinite(evaluate(f"= {formula}", NAMES))
            except FormulaError:
                refused += 1
            slowest = max(slowest, time.thread_time() - begin)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        gc.enable()
    assert 900 < refused < len(formulas) - 50
    assert slowest < 0.2 and peak < 10e6  # most of it of parsed formulas, which are kept


def test_a_formula_is_refused_at_its_line_even_where_no_key_uses_it(tmp_path):
    path = tmp_path / "strings.toml"
    path.write_text(PATCH.replace("FORMULA", "f; 1").replace("OTHER", "'a'*99"), "utf-8")
    with pytest.raises(engine.PatchError) as error:
        engine.load(path)
    assert [(fault.path, fault.line) for fault in error.value.faults] == [
        ("key.body[0].frequency", PATCH[: PATCH.index("FORMULA")].count("\n") + 1),
        ("key.body[1].mass", PATCH[: PATCH.index("OTHER")].count("\n") + 1),
    ]
    assert "it is not an arithmetic expression; use numbers" in error.value.faults[0].message
    assert "'a' is not arithmetic; use numbers" in error.value.faults[1].message


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("= exp", "exp is a function; give its arguments, as in exp(n)"),
        ("= exp(1, 2, 3)", "a function has the wrong number of arguments"),
        ("= 2 * min + 1", "min is a function"),
    ],
)
def test_a_function_without_its_arguments_is_said_in_plain_words(formula, says):
    with pytest.raises(FormulaError, match=re.escape(says)):
        evaluate(formula, {"n": 1.0})
