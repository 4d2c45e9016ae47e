"""What tables are made with: nothing whose last digits depend on the processor or the C library."""

import ast
from pathlib import Path

import pytest
from conftest import ROOT

ROOMS = "arithmetic", "bodies", "instrument", "patch", "assembly"
FILES = [path for room in ROOMS for path in sorted((ROOT / "engine" / room).rglob("*.py"))]
UNSAFE = {
    "math": "acos acosh asin asinh atan atan2 atanh cbrt cos cosh dist erf exp exp2 expm1 fma gamma hypot lgamma log "
    "log10 log1p log2 pow sin sinh sumprod tan tanh",
    "np": "angle arccos arcsin arctan arctan2 arctanh cbrt convolve correlate cos cosh dot einsum exp exp2 expm1 hypot "
    "inner interp linalg log log10 log1p log2 logaddexp matmul polynomial power sin sinc sinh tan tanh tensordot "
    "trapz vdot",
}
NAMES = {f"{module}.{name}" for module, names in UNSAFE.items() for name in names.split()}
LIMIT = "**", "a limit above which a patch is refused"
ALLOWED = {  # of a file: how its uses begin or end, and why they do no harm
    "arithmetic/eigenpairs.py": ("", "a first guess, which is refined and rounded"),
    "arithmetic/function_tables.py": ("", "numbers of 60 digits, and powers of two and of one"),
    "arithmetic/products.py": ("@", "products of whole numbers, exact in any order"),
    "arithmetic/two_parts.py": ("@", "products of whole numbers, exact in any order"),
    "arithmetic/plain_numbers.py": ("math.pow", "powers of zeros and infinities, alike everywhere"),
    "assembly/connections.py": ("np.linalg", "an energy, rounded to nine digits"),
    "assembly/external_forces.py": ("scipy.signal", "noise in a band, which differs by the C library"),
    "bodies/cylinder_modes.py": LIMIT,
    "bodies/initial_shape.py": ("scipy.interpolate.", "shapes of given places, which may differ in their last digits"),
    "bodies/plate_modes.py": LIMIT,
    "bodies/side_functions.py": ("np.", "polynomials of whole numbers, term by term, and an inverse of whole numbers"),
    "patch/tables.py": LIMIT,
}


def find_unsafe(path: Path) -> list[str]:
    """List what a file computes with that differs from machine to machine."""
    found = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Attribute) and ast.unparse(node) in NAMES:
            found.append(ast.unparse(node))
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            found.append("@")
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            parts = node.left, node.right
            if not all(isinstance(ast.literal_eval(part), int | float) for part in parts if is_literal(part)):
                found.append("**")
            elif not (is_literal(node.left) and is_literal(node.right)):
                found.append(ast.unparse(node))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scipy"):
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


def is_literal(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) or (isinstance(node, ast.UnaryOp) and isinstance(node.operand, ast.Constant))


@pytest.mark.parametrize("path", FILES, ids=lambda path: "/".join(path.parts[-2:]))
def test_tables_have_the_same_bits_on_every_machine(path):
    use, _ = ALLOWED.get("/".join(path.parts[-2:]), (None, ""))
    assert [found for found in find_unsafe(path) if use is None or use not in found] == []


@pytest.mark.parametrize("name", ALLOWED)
def test_nothing_is_allowed_that_is_not_there(name):
    assert any(ALLOWED[name][0] in found for found in find_unsafe(ROOT / "engine" / name))


@pytest.mark.parametrize(
    "line", ["np.exp(x)", "math.sin(x)", "a @ b", "x**3", "np.linalg.solve(a, b)", "from scipy.special import jv"]
)
def test_what_is_unsafe_is_found(tmp_path, line):
    (tmp_path / "one.py").write_text(line, "utf-8")
    assert len(find_unsafe(tmp_path / "one.py")) == 1
