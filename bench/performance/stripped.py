"""The kernel as it would be had the absent effects never been written: for comparison with a special one.

`python -m bench.performance.stripped FOLDER` (with `engine` from FOLDER) prints, as JSON, the instructions of the
sample loop for the base scene and the time of a sample.
"""

import ast
import json
import shutil
import sys
import time
from pathlib import Path

import numpy as np

import engine
from engine.kernel.data import effects
from engine.kernel.data.enums import Energies
from engine.patch.accuracy import Accuracy

PRESENT = "SPRINGS"  # the effect that the base scene has; all others must be met, or nothing was proven
ABSENT = {name for name, value in vars(effects).items() if name.isupper() and isinstance(value, int)}
ABSENT -= {PRESENT, "EFFECTS"}
FRAMES = 4096


def base(modes: int = 24) -> engine.Scene:
    """Free modes without loss, with a pickup on one of them."""
    body = {"name": "body", "kind": "modes", "frequency": [110.0 * (i + 1) for i in range(modes)]}
    points = {"points": {"ear": [1.0 + 0.01 * i for i in range(modes)]}}
    return engine.Scene.model_validate({"body": [body | points], "pickup": [{"body": "body", "at": "ear"}]})


class Strip(ast.NodeTransformer):
    """Resolves `EFFECTS & EFFECT`, as a statement or as an expression, for absent effects, and keeps their names."""

    def __init__(self) -> None:
        self.met: set[str] = set()

    def is_absent(self, test: ast.expr) -> bool:
        """Whether a condition asks for absent effects alone."""
        if not (isinstance(test, ast.BinOp) and isinstance(test.left, ast.Name) and test.left.id == "EFFECTS"):
            return False
        return {name.id for name in ast.walk(test.right) if isinstance(name, ast.Name)} <= ABSENT

    def keep_names(self, test: ast.expr) -> None:
        self.met |= {name.id for name in ast.walk(test) if isinstance(name, ast.Name)} & ABSENT

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        if self.is_absent(node.test):
            self.keep_names(node.test)
            return node.orelse or ast.Pass()
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        if self.is_absent(node.test):
            self.keep_names(node.test)
            return node.orelse
        return node


def strip(source: Path, folder: Path) -> None:
    """A copy of the engine in `folder`, its kernels without the absent effects. Raises LookupError if no kernel asks
    for one of them: it has another name by now."""
    shutil.copytree(source / "engine", folder / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(source / "patches", folder / "patches")
    stripping = Strip()
    for path in sorted((folder / "engine" / "kernel").rglob("*.py")):
        tree = stripping.visit(ast.parse(path.read_text("utf-8")))
        path.write_text(ast.unparse(ast.fix_missing_locations(tree)), "utf-8")
    if unknown := ABSENT - stripping.met:
        raise LookupError(f"no kernel asks whether there is {', '.join(sorted(unknown))}")


def instructions(assembly: str) -> int:
    """Instructions in an assembly listing."""
    lines = (line.strip() for line in assembly.splitlines())
    return sum(1 for line in lines if line and not line.startswith((".", "#", ";")) and not line.endswith(":"))


def measure(scene: engine.Scene) -> dict[str, float]:
    """Instructions of the sample loop, freshly compiled, and ns per sample (minimum of many short runs)."""
    from engine.assembly.build import build
    from engine.compiler.struct_handle import StructHandle
    from engine.kernel.run.render_block import render_block
    from engine.runtime.job_memory import block_output

    model, state, _ = build(scene, 44_100, Accuracy(silence=-np.inf))
    state.p[:] = 1.0
    output = block_output(np.zeros((FRAMES, 1)), np.zeros((0, 0)), Energies.NEVER)
    held = StructHandle(model), StructHandle(state), StructHandle(output)
    render_block(*held, 0, FRAMES)
    best = np.inf
    for _ in range(60):
        begin = time.perf_counter()
        render_block(*held, 0, FRAMES)
        best = min(best, time.perf_counter() - begin)
    assembly = "".join(render_block.inspect_asm(s) for s in render_block.signatures)
    return {"instructions": instructions(assembly), "ns": best / FRAMES * 1e9}


if __name__ == "__main__":
    assert Path(engine.__file__).is_relative_to(sys.argv[1]), engine.__file__
    print(json.dumps(measure(base())))
