"""No test passes because a list was empty: each makes a check that is not in a loop, or loops over what the file
lists."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from source_trees import tree_of

TESTS = sorted((ROOT / "tests").rglob("test_*.py"))
ALL_FILES = sorted((ROOT / "tests").rglob("*.py"))
CHECKING = "assert", "check", "raises", "warns", "fail"  # how what may fail a test is called, besides helpers
COUNTED = "range", "linspace", "arange", "geomspace", "logspace", "count"  # as many as their numbers say
KEEPING = "enumerate", "sorted", "reversed", "list", "tuple", "set", "dict", "zip", "product", "pairwise"
Function = ast.FunctionDef | ast.AsyncFunctionDef
Comprehension = ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp


def name_of(node: ast.AST) -> str:
    """Last part of a name, or of that of a call's function."""
    node = node.func if isinstance(node, ast.Call) else node
    return getattr(node, "attr", getattr(node, "id", ""))


@functools.cache
def checking_names() -> frozenset[str]:
    """Names of functions in the tests that check something, or call one that does."""
    checks, calls = frozenset[str](), dict[str, set[str]]()
    for function in (f for path in ALL_FILES for f in ast.walk(tree_of(path)) if isinstance(f, Function)):
        inner = [node for node in ast.walk(function) if isinstance(node, ast.Call | ast.Assert)]
        calls.setdefault(function.name, set()).update(
            n.func.id for n in inner if isinstance(getattr(n, "func", 0), ast.Name)
        )
        if any(is_check(node, frozenset()) for node in inner):
            checks |= {function.name}
    while more := {name for name, called in calls.items() if name not in checks and called & checks}:
        checks |= more
    return checks


def is_check(node: ast.AST, helpers: frozenset[str]) -> bool:
    if isinstance(node, ast.Call):
        named = isinstance(node.func, ast.Name) and node.func.id in helpers
        return named or name_of(node).startswith(CHECKING)
    return isinstance(node, ast.Assert)


def assigned_in(scope: list[ast.AST]) -> dict[str, ast.expr]:
    """Names that are assigned, and what."""
    pairs = [(target, node.value) for node in scope if isinstance(node, ast.Assign) for target in node.targets]
    pairs += [(node.target, node.value) for node in scope if isinstance(node, ast.AnnAssign) and node.value]
    return {target.id: value for target, value in pairs if isinstance(target, ast.Name)}


def may_be_empty(values: ast.expr, known: dict[str, ast.expr]) -> bool:
    """Whether an iterable may be empty, as far as its file says."""
    match values:
        case ast.List(elts=items) | ast.Tuple(elts=items) | ast.Set(elts=items):
            return all(isinstance(item, ast.Starred) and may_be_empty(item.value, known) for item in items)
        case ast.Dict(keys=keys):
            return not keys
        case ast.Constant(value=str(text)):
            return not text
        case ast.BinOp(left=left, right=right, op=ast.Add() | ast.BitOr()):
            return may_be_empty(left, known) and may_be_empty(right, known)
        case ast.Name(id=name) if name in known:
            return may_be_empty(known[name], {other: value for other, value in known.items() if other != name})
        case ast.Name(id=name) | ast.Attribute(attr=name) | ast.Subscript(value=ast.Name(id=name)) if name.isupper():
            return False  # a constant of another file
        case ast.ListComp() | ast.SetComp() | ast.GeneratorExp() | ast.DictComp():
            return any(part.ifs or may_be_empty(part.iter, known) for part in values.generators)
        case ast.Call(func=ast.Attribute(value=of, attr="items" | "keys" | "values" | "split" | "splitlines")):
            return may_be_empty(of, known)
        case ast.Call(args=args):
            if name_of(values) in COUNTED:
                return False
            one_is_enough = name_of(values) == "zip" and bool(values.keywords)
            empty = [may_be_empty(argument, known) for argument in args]
            return name_of(values) not in KEEPING or not args or (all(empty) if one_is_enough else any(empty))
    return True


def proofs_of(node: ast.AST, known: dict[str, ast.expr], looped: bool = False) -> Iterator[bool]:
    """For each check, whether it is made whatever the lists hold."""
    helpers = checking_names()
    if isinstance(node, ast.For):
        looped = looped or may_be_empty(node.iter, known)
    if is_check(node, helpers):
        yield not looped and not (isinstance(node, ast.Assert) and passes_if_empty(node.test, known))
    for child in ast.iter_child_nodes(node):
        yield from proofs_of(child, known, looped)


def passes_if_empty(test: ast.expr, known: dict[str, ast.expr]) -> bool:
    """Whether a condition is `all(... for ... in ...)`, or `not any(...)`, of what may be empty."""
    wanted = "all"
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        test, wanted = test.operand, "any"
    if not (isinstance(test, ast.Call) and name_of(test) == wanted and isinstance(test.func, ast.Name) and test.args):
        return False
    [items] = test.args
    parts = items.generators if isinstance(items, Comprehension) else []
    return any(part.ifs or may_be_empty(part.iter, known) for part in parts)


def empty_proofs(path: Path) -> list[str]:
    """Tests of a file that check nothing where their lists are empty."""
    tree, found = tree_of(path), []
    for test in ast.walk(tree):
        if not isinstance(test, Function) or not test.name.startswith("test_"):
            continue
        known = assigned_in(tree.body) | assigned_in(list(ast.walk(test)))
        known |= {name: ast.List([ast.Constant(name)]) for name in parametrised(test)}
        proofs = list(proofs_of(test, known))
        if proofs and not any(proofs):
            found.append(f"{path.name}:{test.lineno} {test.name}")
    return found


def parametrised(test: Function) -> list[str]:
    """Arguments of a test that parametrize gives."""
    marks = [mark for mark in test.decorator_list if name_of(mark) == "parametrize" and isinstance(mark, ast.Call)]
    texts = [text.value for mark in marks for text in ast.walk(mark.args[0]) if isinstance(text, ast.Constant)]
    return [name.strip() for text in texts for name in str(text).split(",")]


def test_no_test_passes_because_a_list_is_empty():
    assert TESTS
    assert [found for path in TESTS for found in empty_proofs(path)] == []


@pytest.mark.parametrize(
    ("lines", "is_empty"),
    [
        (["for x in found():", "    assert x > 0"], True),
        (["xs = [x for x in (1, 2) if x > 2]", "for x in xs:", "    assert x"], True),
        (["for x in found() - {1}:", "    with pytest.raises(ValueError):", "        run(x)"], True),
        (["assert all(x > 0 for x in found())"], True),
        (["assert not any(x > 0 for x in found())"], True),
        (["for x in found():", "    assert x > 0", "assert found()"], False),
        (["xs = (1, 2)", "for i, x in enumerate(xs):", "    assert x > i"], False),
        (["for x in range(3):", "    for y in found():", "        assert x", "    assert x > 0"], False),
        (["for x, y in zip((1, 2), found(), strict=True):", "    assert x == y"], False),
    ],
    ids=str,
)
def test_tests_that_an_empty_list_passes_are_found(lines, is_empty, tmp_path):
    path = tmp_path / "test_it.py"
    path.write_text("\n    ".join(["def test_it():", *lines]))
    assert bool(empty_proofs(path)) == is_empty
