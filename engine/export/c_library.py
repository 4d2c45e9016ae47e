"""A patch as a library in C: a header, an object file with the kernel and the tables of the patch, and an example."""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import numpy as np

from engine.assembly.build import build
from engine.assembly.table_changes import scored_exchanges
from engine.compiler.kinds import INT
from engine.compiler.machine_code import TARGETS, neutral_code, object_code
from engine.compiler.struct_handle import pointer_kind
from engine.export.faults import CannotExport
from engine.export.scene_bytes import SceneBytes
from engine.export.whole_scene import Whole, render_whole
from engine.kernel.data.enums import BALANCE_SIZE, Balance, Energies, Ledger
from engine.output_files import atomic_write, write_text
from engine.patch.frames import frame_count
from engine.patch.scene import Scene
from engine.runtime.job_memory import block_output

BLOCK = 128  # samples computed at a time
SOURCES = ("fdh.h", "fdh.c", "main.c", "CMakeLists.txt")
HEADER, OBJECT = "fdh_patch.h", "fdh_patch.o"


def export_c(
    scene: Scene,
    folder: Path,
    target: str = "x86_64-linux",
    seconds: float | None = None,
    samplerate: int = 44_100,
) -> list[Path]:
    """Write a scene as a library in C to a folder, which is made if it is not there. Returns the files.

    target: a key of TARGETS

    Raises ValueError for an unknown target or a scene that cannot be exported, BuildError (a ValueError) if it cannot
    be built, OSError if a file cannot be written.
    """
    if target not in TARGETS:
        raise ValueError(f"no target is called {target!r}; there are {', '.join(TARGETS)}")
    seconds = scene.seconds if seconds is None else seconds
    built = build(scene, samplerate, scene.accuracy, seconds)
    if scene.accuracy.oversample > 1:
        raise CannotExport("a patch with oversample cannot be exported: in C there is no filter to decimate it")
    if scored_exchanges(scene, built, accuracy=scene.accuracy, seconds=seconds):
        raise CannotExport("a patch whose events change bodies cannot be exported yet")
    output = block_output(np.zeros((BLOCK, scene.channels)), np.zeros((len(Ledger), BLOCK)), Energies.AT_EACH_SAMPLE)
    whole = Whole(np.zeros((BLOCK, scene.channels)), np.zeros((len(Ledger), BLOCK)), np.zeros(BALANCE_SIZE))
    values = {"model": built.model, "state": built.state, "output": output, "whole": whole}
    kinds = (*map(pointer_kind, values.values()), INT)
    laid_out = SceneBytes(pointer_bytes=8)
    for name, value in values.items():
        laid_out.add(name, value)
    code = neutral_code(render_whole.py_func.__module__, render_whole.py_func.__name__, kinds)
    tables = {"fdh_scene": bytes(laid_out.content), "fdh_pointers": np.array(laid_out.pointers, np.int64).tobytes()}
    content = object_code({"fdh_render": code}, TARGETS[target], tables)
    numbers = _numbers(laid_out, whole) | {
        "CHANNELS": scene.channels,
        "SAMPLERATE": samplerate,
        "LENGTH": frame_count(seconds, samplerate),
        "BLOCK": BLOCK,
    }
    return _write_files(folder, numbers, content)


def _numbers(laid_out: SceneBytes, whole: Whole) -> dict[str, int]:
    """Return the numbers of the scene's bytes, by their names in C."""
    return {
        "SIZE": len(laid_out.content),
        "POINTERS": len(laid_out.pointers),
        **{name.upper(): place for name, place in laid_out.values.items()},
        "AUDIO": laid_out.place_of(whole.audio),
        "BALANCE": laid_out.place_of(whole.balance),
        "MAX_ERROR": int(Balance.MAX_ERROR),
        "LARGEST": int(Balance.LARGEST),
    }


def _write_files(folder: Path, numbers: Mapping[str, int], content: bytes) -> list[Path]:
    """Write the files of a library; each is complete or not there. Returns them."""
    folder.mkdir(exist_ok=True)
    for name in SOURCES:
        write_text(folder / name, files("engine.export").joinpath("c", name).read_text("utf-8"))
    lines = [f"#define FDH_{name} {number}" for name, number in numbers.items()]
    write_text(folder / HEADER, "/* Numbers of this patch, for fdh.c. */\n" + "\n".join(lines) + "\n")
    with atomic_write(folder / OBJECT) as path:
        path.write_bytes(content)
    return [folder / name for name in (*SOURCES, HEADER, OBJECT)]
