"""The tables of the shipped patches in this process, under whatever settings of NumPy, OpenBLAS and the C library it
was started with: `python -m bench.accuracy.machine_tables [FOLDER NAME …]` prints their digests as JSON, and what the
settings came to; or with a FOLDER, writes samples of the named patches into it.
"""

import hashlib
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

import engine
from engine.assembly.table_digest import digest_scene
from engine.files import SHIPPED_PATCHES, shipped_names
from engine.provenance import blas_processor

SECONDS = 0.5  # of the samples that are compared
FUNCTIONS = math.exp, math.log, math.sin, math.cos, math.tan, math.atan, math.pow
ARGUMENTS = 20_000  # of each function: enough to meet some whose last bit depends on fused multiply-adds


def load(name: str) -> engine.Scene:
    """The shipped patch of a name, whatever lies in this folder."""
    return engine.load(SHIPPED_PATCHES / f"{name}.toml")


def digests() -> dict[str, str]:
    """The digest of the tables of each shipped patch."""
    return {name: digest_scene(load(name)) for name in shipped_names()}


def numpy_features() -> dict[str, list[str]]:
    """The features of the processor that NumPy can be told not to use, and those of them that it uses."""
    from numpy._core import _multiarray_umath as numbers

    optional = list(numbers.__cpu_dispatch__)
    return {"optional": optional, "used": [name for name in optional if numbers.__cpu_features__[name]]}


def libm_digest() -> str:
    """A digest of results of the elementary functions of the C library."""
    results = np.array(
        [f(x, 1.5) if f is math.pow else f(x) for f in FUNCTIONS for x in np.linspace(0.01, 30.0, ARGUMENTS)]
    )
    return hashlib.sha256(results.tobytes()).hexdigest()[:16]


def readings() -> dict[str, Any]:
    """The digests, and what the settings came to."""
    came_to = {"numpy": numpy_features(), "blas": blas_processor(), "libm": libm_digest()}
    return {"digests": digests(), **came_to}


def main(words: list[str]) -> None:
    """Print the readings, or write samples."""
    if not words:
        print(json.dumps(readings()))
        return
    folder, *names = words
    for name in names:
        scene = load(name)
        rendering = engine.render(scene, min(SECONDS, scene.seconds), kernel="general")
        np.save(Path(folder) / f"{name}.npy", rendering.audio)


if __name__ == "__main__":
    main(sys.argv[1:])
