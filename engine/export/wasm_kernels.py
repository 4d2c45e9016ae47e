"""The kernels of a page as one WebAssembly module: those of live sound, which the engine runs as well.

The general ones come with the engine, so that nothing is compiled. The special ones of a scene are compiled for it,
which takes a minute; they are half as large and fast.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from engine.compiler import cache
from engine.compiler.kinds import as_kind, effects_of
from engine.compiler.machine_code import neutral_code, object_code
from engine.compiler.shipped import archive, read_member, sources_of
from engine.compiler.special_kernels import ALL, VARIABLE
from engine.compiler.targets import WASM
from engine.compiler.wasm_module import with_exports
from engine.export.faults import CannotExport
from engine.export.player_bytes import Requests
from engine.live.player import Player

ARCHIVE = archive(WASM)
GENERAL, REFINED = "general.wasm", "refined.wasm"  # its modules: of scenes with one step a sample, and with stages


def compile_module(requests: Requests) -> bytes:
    """Compile kernels to a WebAssembly module, whose functions take 64-bit integers. It needs a minute, and of the
    general ones minutes and much memory.

    It is done in a process of its own: of functions that were compiled here before, Numba would link code that is
    already fitted to this machine. Raises subprocess.CalledProcessError if it fails.
    """
    effects = next((found for _, _, kinds in requests.values() if (found := effects_of(kinds)) != ALL), ALL)
    command, environment = [sys.executable, "-m", __name__], os.environ | {VARIABLE: str(effects)}
    asked, folder = json.dumps(requests).encode(), Path(__file__).parents[2]
    return subprocess.run(command, input=asked, stdout=subprocess.PIPE, cwd=folder, env=environment, check=True).stdout


def compile_here(requests: Requests) -> bytes:
    """Compile kernels to a WebAssembly module, in a process that has compiled nothing yet."""
    codes = {name: neutral_code(*request) for name, request in requests.items()}
    return with_exports(object_code(codes, WASM, {}).content, list(codes))


def general_module_of(player: Player) -> str:
    """Return the name of the module of the general kernels that a player needs."""
    return GENERAL if player.model.refinement is None else REFINED


def read_module(name: str, path: Path = ARCHIVE) -> bytes:
    """Return a module of an archive, that which comes with the engine if no other is given. Raises CannotExport if it
    is not there, or of other sources."""
    if sources_of(path) != cache.source_digest():
        raise CannotExport(
            "the kernel for browsers that came with the engine is not of these sources; give --kernel special, or make"
            " it with: python -m bench shipped"
        )
    return read_member(path, name)


if __name__ == "__main__":
    asked = json.load(sys.stdin)
    requests = {name: (module, function, as_kind(kinds)) for name, (module, function, kinds) in asked.items()}
    sys.stdout.buffer.write(compile_here(requests))
