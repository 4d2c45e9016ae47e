"""The kernel as it would be had the absent effects never been written: for comparison with the one Numba prunes.

`python -m bench.stripped FOLDER` (with `engine` from FOLDER) prints, as JSON, the instructions of the
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
from engine.accuracy import Accuracy

# the names by which kernels know an effect that the base scene has not
ABSENT = {
    "loss",
    "gravity",
    "force",
    "contact",
    "partner",
    "damping",
    "coupling",
    "events",
    "loose",
    "trace",
    "scratch",
}
KERNELS = ("block", "contact", "energy", "events", "force", "modes", "rest", "solve")
FRAMES = 4096


def base(modes: int = 24) -> engine.Scene:
    """Free modes without loss, one of which is heard."""
    body = {"name": "body", "kind": "modes", "frequency": [110.0 * (i + 1) for i in range(modes)]}
    points = {"points": {"ear": [1.0 + 0.01 * i for i in range(modes)]}}
    return engine.Scene.model_validate({"body": [body | points], "pickup": [{"body": "body", "at": "ear"}]})


class Strip(ast.NodeTransformer):
    """Resolves `if effect is None` and `if effect is not None` for absent effects."""

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        test = node.test
        if isinstance(test, ast.Compare) and isinstance(test.left, ast.Name) and test.left.id in ABSENT:
            if isinstance(test.ops[0], ast.Is):
                return node.body
            if isinstance(test.ops[0], ast.IsNot):
                return node.orelse or ast.Pass()
        return node


def strip(source: Path, folder: Path) -> None:
    """A copy of the engine in `folder`, its kernels without the absent effects."""
    shutil.copytree(source / "engine", folder / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    for name in KERNELS:
        path = folder / "engine" / f"{name}.py"
        tree = Strip().visit(ast.parse(path.read_text("utf-8")))
        path.write_text(ast.unparse(ast.fix_missing_locations(tree)), "utf-8")


def instructions(assembly: str) -> int:
    """Instructions in an assembly listing."""
    lines = (line.strip() for line in assembly.splitlines())
    return sum(1 for line in lines if line and not line.startswith((".", "#", ";")) and not line.endswith(":"))


def measure(scene: engine.Scene) -> dict[str, float]:
    """Instructions of the sample loop, freshly compiled, and ns per sample (minimum of many short runs)."""
    from engine.block import block
    from engine.build import build
    from engine.held import Held
    from engine.model import Room

    model, state, _ = build(scene, 44_100, Accuracy(silence=-np.inf))
    state.p[:] = 1.0
    held = Held(model), Held(state), Held(Room(np.zeros((FRAMES, 1)), None, None))
    block(*held, 0, FRAMES)
    best = np.inf
    for _ in range(60):
        begin = time.perf_counter()
        block(*held, 0, FRAMES)
        best = min(best, time.perf_counter() - begin)
    assembly = "".join(block.inspect_asm(s) for s in block.signatures)
    return {"instructions": instructions(assembly), "ns": best / FRAMES * 1e9}


if __name__ == "__main__":
    assert Path(engine.__file__).is_relative_to(sys.argv[1]), engine.__file__
    print(json.dumps(measure(base())))
