"""The shape of the engine in numbers: `uv run python -m tests.docs.kernel_shape [CHECKOUT]`. test_structure.py and
test_kernel_shape.py hold them.

All is counted from syntax trees: nothing of the engine is imported, so that another checkout can be measured too.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
KERNEL = ROOT / "engine" / "kernel"
DATA = "model", "state", "axes", "enums", "island_view"  # files that list what there is
# identifiers that show that a function knows an effect, and the files that are the effect's own
EFFECTS = {
    "weight": (re.compile(r"weight"), ("potential",)),
    "connections": (re.compile(r"connection"), ("connection", "connected", "near_contacts")),
    "contact loss": (re.compile(r"contact_loss|loss_rate"), ("contact_loss", "power_law", "law", "scalar_contact")),
}
MAX_ARGUMENTS = 6
OTHER_WAYS = "begin_flight", "step_saved_motion", "advance_free_masses"  # to advance a sample, without a StepOutcome


class Function(NamedTuple):
    """A function of the kernel."""

    file: str  # without its ending
    name: str
    arguments: int
    identifiers: frozenset[str]  # names and attributes in it, its arguments among them
    makes_outcome: bool  # whether it says what a step did


class Shape(NamedTuple):
    """What can be counted of the kernel."""

    lines: int
    files: int
    arrows: int  # from a file to another that it imports
    ways: int  # to advance a sample
    know: dict[str, int]  # functions outside an effect's own files that know it, by its name
    wide: int  # functions of more than MAX_ARGUMENTS arguments


def kernel_files() -> list[Path]:
    """Return all files of the kernel that have code."""
    return sorted(path for path in KERNEL.rglob("*.py") if path.stem != "__init__")


def functions_of(path: Path) -> list[Function]:
    """Return all functions of a file, those within others as parts of these."""
    tree = ast.parse(path.read_text("utf-8"))
    return [_describe(path.stem, node) for node in tree.body if isinstance(node, ast.FunctionDef)]


def _describe(file: str, node: ast.FunctionDef) -> Function:
    inner = list(ast.walk(node))
    names = {n.id for n in inner if isinstance(n, ast.Name)} | {n.attr for n in inner if isinstance(n, ast.Attribute)}
    names |= {n.arg for n in inner if isinstance(n, ast.arg)}
    calls = {n.func.id for n in inner if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    count = len(node.args.args) + len(node.args.kwonlyargs)
    return Function(file, node.name, count, frozenset(names), "StepOutcome" in calls)


def imports_of(path: Path) -> set[str]:
    """Return the files of the kernel that a file imports."""
    tree = ast.parse(path.read_text("utf-8"))
    modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {module for module in modules if module.startswith("engine.kernel.")}


def measure_kernel() -> Shape:
    """Count everything."""
    files = kernel_files()
    functions = [function for path in files for function in functions_of(path)]
    know = {}
    for effect, (word, own) in EFFECTS.items():
        outside = [f for f in functions if f.file not in DATA and not (own and f.file.startswith(own))]
        know[effect] = sum(any(map(word.search, f.identifiers)) for f in outside)
    return Shape(
        lines=sum(len(path.read_text("utf-8").splitlines()) for path in files),
        files=len(files),
        arrows=sum(len(imports_of(path)) for path in files),
        ways=sum(f.makes_outcome for f in functions) + sum(f.name in OTHER_WAYS for f in functions),
        know=know,
        wide=sum(f.arguments > MAX_ARGUMENTS for f in functions),
    )


# --- of the whole engine: what issue 68 counts

# identifiers by which a file names an effect, and files and folders that are the effect's own
NAMED_EFFECTS = {
    "friction": (re.compile(r"friction|slides|bristle", re.IGNORECASE), re.compile(r"friction|bow|rubb")),
    "stretching": (re.compile(r"stretch|(?<![a-z])tension", re.IGNORECASE), re.compile(r"stretch|(?<![a-z])tension")),
    "connections": (re.compile(r"connect", re.IGNORECASE), re.compile(r"connect")),
}
BRANCHING_ROOMS = "run", "interactions", "modes"
# what a test of the kernel calls or names to learn whether an effect is there, or what it allows
ABILITY = re.compile(
    r"(has_(connections|contacts|external_forces|friction)|stretches|moves_by_basis|is_damping|damps_in_halves"
    r"|(has|acts_on)_more_than_(damping|loss)|abilities|Ability)$"
)
PREDICATE = re.compile(r"(is|are|has|have|can|may|must|was|were|leaves_out|falls|closes)_")
WORD = re.compile(r"[\w.]+")  # a text that is a name
ANSWER = re.compile(r"(Returns? )?True if ")  # begins the docstring of a predicate
WRITERS = {"store_lanes": {0}, "put_number": {0}}  # of the compiler: the arguments that they write to
WRITING_METHODS = "fill", "sort"


class Counts(NamedTuple):
    """What can be counted of the engine."""

    kernel_lines: int
    engine_lines: int
    wide: list[str]  # functions of more than MAX_ARGUMENTS arguments
    writing_predicates: list[str]  # of the kernel, that assign to what they are given, or call what does
    know: dict[str, list[str]]  # files outside an effect's own that name it, by its name
    branches: list[str]  # on an effect or an ability, in BRANCHING_ROOMS
    gates: list[str]  # of the kernel: tests of the constant of effects, which special kernels leave out
    none_tests: list[str]  # functions of the kernel that test for None


def measure_engine(root: Path = ROOT) -> Counts:
    """Count everything in a checkout; each list has the places, file and function or line."""
    engine = root / "engine"
    trees = {path.relative_to(engine).with_suffix("").as_posix(): _parse(path) for path in sorted(engine.rglob("*.py"))}
    kernel = {name: tree for name, tree in trees.items() if name.startswith("kernel/")}
    lines = {name: len((engine / f"{name}.py").read_text("utf-8").splitlines()) for name in trees}
    return Counts(
        kernel_lines=sum(lines[name] for name in kernel),
        engine_lines=sum(lines.values()),
        wide=[f"{name}.{f.name}" for name, tree in trees.items() for f in _functions(tree) if _is_wide(f)],
        writing_predicates=find_writing_predicates(kernel),
        know={effect: files_that_know(effect, trees) for effect in NAMED_EFFECTS},
        branches=[place for name, tree in kernel.items() for place in _find_branches(name, tree)],
        gates=[place for name, tree in kernel.items() for place in _find_gates(name, tree)],
        none_tests=[f"{name}.{f.name}" for name, tree in kernel.items() for f in _functions(tree) if _tests_none(f)],
    )


def _parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def _functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    """Yield all functions and methods, those within others too."""
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def _parameters(function: ast.FunctionDef) -> list[str]:
    """Return the names of the arguments, those by keyword last, without `self`."""
    names = [a.arg for a in (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def _is_wide(function: ast.FunctionDef) -> bool:
    return len(_parameters(function)) > MAX_ARGUMENTS


def files_that_know(effect: str, trees: dict[str, ast.Module]) -> list[str]:
    """List the files outside an effect's own that have an identifier of it, or quote its name."""
    word, own = NAMED_EFFECTS[effect]
    others = {name: tree for name, tree in trees.items() if not own.search(name)}
    return [name for name, tree in others.items() if any(word.search(x) for x in _identifiers(tree))]


def identifiers_of(path: Path) -> set[str]:
    """Return the identifiers of a file, and the words that it quotes."""
    return set(_identifiers(_parse(path)))


def _identifiers(tree: ast.AST) -> Iterator[str]:
    """Yield the names, attributes, arguments and keywords in a tree, the names of what it defines and imports, and the
    words that it quotes, such as "friction"."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.arg | ast.keyword):
            yield node.arg or ""
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.alias):
            yield node.name.rpartition(".")[2]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and WORD.fullmatch(node.value):
            yield node.value


def _find_branches(name: str, tree: ast.AST) -> Iterator[str]:
    """Yield each question about an effect or an ability, by file and line."""
    if name.split("/")[1] not in BRANCHING_ROOMS:
        return
    for node in ast.walk(tree):
        called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
        named = node.id if isinstance(node, ast.Name) and node.id.isupper() else ""
        named = node.attr if isinstance(node, ast.Attribute) else named
        if ABILITY.match(called) or (named and ABILITY.match(named)):
            yield f"{name}:{node.lineno}"


def _find_gates(name: str, tree: ast.AST) -> Iterator[str]:
    """Yield each test of the constant of effects, by file and line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.left, ast.Name) and node.left.id == "EFFECTS":
            yield f"{name}:{node.lineno}"


def _tests_none(function: ast.FunctionDef) -> bool:
    """True if a function compares something with None, or asks is_none."""
    for node in ast.walk(function):
        operands = [node.left, *node.comparators] if isinstance(node, ast.Compare) else []
        if any(isinstance(x, ast.Constant) and x.value is None for x in operands):
            return True
    return False


# --- predicates that write


def find_writing_predicates(trees: dict[str, ast.Module]) -> list[str]:
    """List the functions named or described as an answer, yes or no, that write to their arguments."""
    functions = [(name, function) for name, tree in trees.items() for function in _functions(tree)]
    writes: dict[str, set[int]] = {name: set(arguments) for name, arguments in WRITERS.items()}
    is_complete = False
    while not is_complete:  # what a function writes may be through others that it calls
        is_complete = True
        for _, function in functions:
            found = _written_arguments(function, writes)
            if not found <= writes.get(function.name, set()):
                writes[function.name] = writes.get(function.name, set()) | found
                is_complete = False
    return [f"{name}.{f.name}" for name, f in functions if is_predicate(f) and writes.get(f.name)]


def is_predicate(function: ast.FunctionDef) -> bool:
    """True if a function's name or docstring says that it answers yes or no."""
    return bool(PREDICATE.match(function.name) or ANSWER.match(ast.get_docstring(function) or ""))


def _written_arguments(function: ast.FunctionDef, writes: dict[str, set[int]]) -> set[int]:
    """Return the arguments of a function, by number, to whose attributes or items it assigns, itself or through the
    functions of `writes`, by the arguments that these write to."""
    parts = {name: {n} for n, name in enumerate(_parameters(function))}  # which arguments a name may be a part of
    nodes = list(ast.walk(function))
    for _ in range(2):  # a name may be used before the walk has come to its assignment
        for node in nodes:
            for target, value in _assignments(node):
                for name in (
                    n.id for n in ast.walk(target) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
                ):
                    parts.setdefault(name, set()).update(_arguments_in(value, parts))
    written: set[int] = set()
    for node in nodes:
        if isinstance(node, ast.Subscript | ast.Attribute) and isinstance(node.ctx, ast.Store):
            written |= _arguments_in(node.value, parts)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            given = [x for n, x in enumerate(node.args) if n in writes.get(node.func.id, ())]
            written |= set().union(*(_arguments_in(x, parts) for x in given))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in WRITING_METHODS:
            written |= _arguments_in(node.func.value, parts)
    return written


def _assignments(node: ast.AST) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield the targets of an assignment or a loop, each with its value."""
    if isinstance(node, ast.Assign):
        for target in node.targets:
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                yield from zip(target.elts, node.value.elts, strict=False)
            else:
                yield target, node.value
    elif isinstance(node, ast.For):
        yield node.target, node.iter


def _arguments_in(value: ast.expr, parts: dict[str, set[int]]) -> set[int]:
    """Return the arguments that a value may be a part of: a field, an item, or what a function makes of it."""
    if isinstance(value, ast.Name):
        return parts.get(value.id, set())
    if isinstance(value, ast.Attribute | ast.Subscript):
        return _arguments_in(value.value, parts)
    inner: list[ast.expr] = []
    if isinstance(value, ast.Call):
        inner = [x.value if isinstance(x, ast.Starred) else x for x in value.args]
    elif isinstance(value, ast.IfExp):
        inner = [value.body, value.orelse]
    elif isinstance(value, ast.Tuple):
        inner = value.elts
    return set().union(*(_arguments_in(x, parts) for x in inner))


def table_of(counts: Counts) -> list[tuple[str, int]]:
    """Return the counts as rows, with their names."""
    return [
        ("lines of the kernel", counts.kernel_lines),
        ("lines of the engine", counts.engine_lines),
        (f"functions of more than {MAX_ARGUMENTS} arguments", len(counts.wide)),
        ("predicates of the kernel that write", len(counts.writing_predicates)),
        *((f"files that know {effect}", len(files)) for effect, files in counts.know.items()),
        ("branches on an effect or an ability", len(counts.branches)),
        ("tests of the constant of effects", len(counts.gates)),
        ("functions of the kernel that test for None", len(counts.none_tests)),
    ]


def main(words: list[str]) -> None:
    """Print the counts of a checkout, or with --places what is counted. words: of the command line"""
    folders = [Path(word) for word in words if not word.startswith("--")]
    counts = measure_engine(*folders[:1])
    if "--places" in words:
        for name, value in counts._asdict().items():
            lists = value if isinstance(value, dict) else {name: value}
            for title, places in lists.items():
                if isinstance(places, list):
                    print(title, *places, sep="\n  ")
    for title, number in table_of(counts):
        print(f"{title:<45} {number:>6}")
    if not folders:
        for name, value in measure_kernel()._asdict().items():
            print(f"{name:<45} {value}")


if __name__ == "__main__":
    main(sys.argv[1:])
