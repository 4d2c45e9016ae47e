"""The effects that this process compiles kernels with, and processes for other effects.

The constant is frozen in all that a process compiles (engine.kernel.data.effects). So a special kernel, which has the
effects of one scene, is compiled in a process of its own.
"""

import importlib
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

VARIABLE = "FDH_EFFECTS"  # of the environment of such a process
ALL = -1  # every bit: the effects of the general kernel
EFFECTS = int(os.environ.get(VARIABLE, ALL))
_called: list[str] = []  # functions that other processes are at


def call_with_effects(effects: int, module: str, function: str, *arguments: Any) -> Any:
    """Call a function by its names where kernels are compiled with some effects: here, if they are those of this
    process. Raises what it raises; RuntimeError if the process dies, or cannot be started."""
    if effects == EFFECTS:
        return getattr(importlib.import_module(module), function)(*arguments)
    if getattr(sys, "frozen", False):  # its executable is no Python
        raise RuntimeError("a frozen program cannot compile a special kernel; choose the general one")
    command, environment = [sys.executable, "-m", __name__], os.environ | {VARIABLE: str(effects)}
    _called.append(function)
    try:
        done = subprocess.run(
            command,
            input=pickle.dumps((module, function, arguments)),
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[2],
            env=environment,
            check=False,
        )
    finally:
        _called.remove(function)
    if done.returncode != 0:
        raise RuntimeError(f"the process that compiles a special kernel ended with {done.returncode}")
    result = pickle.loads(done.stdout)
    if isinstance(result, Exception):
        raise result
    return result


def is_compiling() -> bool:
    """True while this process waits for another that compiles."""
    return bool(_called)


def answer() -> None:
    """Call the function that the parent asks for, and write what it returns or raises."""
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # what is printed does not get into the answer
    module, function, arguments = pickle.load(sys.stdin.buffer)
    result: Any
    try:
        result = call_with_effects(EFFECTS, module, function, *arguments)
    except Exception as error:
        result = error
    output.write(pickle.dumps(result))


if __name__ == "__main__":
    answer()
