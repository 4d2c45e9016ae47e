"""Make the machine code that comes with the engine (engine.compiler.shipped), from the sources."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

from bench.publish import stale
from engine.assembly.build import build
from engine.assembly.general import generalise
from engine.compiler import cache, machine_code
from engine.compiler.code_objects import to_content
from engine.compiler.kernel_name import KernelName
from engine.compiler.kinds import FLOAT, Kind
from engine.compiler.shipped import ABOUT, FOLDER, TARGETS, archive, member_name
from engine.export.player_bytes import requests_of
from engine.export.row_recorder import player_of_scene
from engine.export.wasm_kernels import ARCHIVE, compile_module, general_module_of
from engine.live.audio_memory import INSERT_USE
from engine.live.kernels import KINDS, PORTAUDIO_CALLBACK
from engine.patch.scene import Scene
from engine.runtime.helpers import HELP_CREW, HELP_CREW_KINDS
from engine.runtime.job_memory import RENDER_JOB, RENDER_JOB_KINDS, RENDER_USE
from engine.runtime.kernel_choice import Prepared, kinds_of

WASM = "wasm"
EPOCH = (1980, 1, 1, 0, 0, 0)  # of all members, so that the same sources make the same archive
SIMPLE = {
    "body": [{"name": "a", "kind": "oscillator", "mass": 1.0, "frequency": 100.0, "displacement": 1.0}],
    "contact": [{"body": "a", "barrier": 0.0, "stiffness": 1e6, "exponent": 1.0}],
    "pickup": [{"body": "a"}],
}
CROSS = {"aarch64": machine_code.TARGETS["aarch64-linux"]}  # made on another machine than they are for
Request = tuple[str, str, tuple[Kind, ...]]
About = dict[str, str | list[str] | tuple[str, ...]]  # what an archive says of itself


def requests() -> list[Request]:
    """The kernels that are shipped: module, function and kinds."""
    fixed = {RENDER_JOB: RENDER_JOB_KINDS, HELP_CREW: HELP_CREW_KINDS, **KINDS}
    wanted = [(kernel.module, kernel.function, kinds) for kernel, kinds in fixed.items()]
    for order in (2, 4):
        scene = Scene.model_validate(SIMPLE | {"accuracy": {"order": order}})
        model, state = generalise(*build(scene, 44_100)[:2])
        general = Prepared([model], state, KernelName.GENERAL)
        wanted += [(u.kernel.module, u.kernel.function, kinds_of(general, u)) for u in (RENDER_USE, INSERT_USE)]
    return wanted


def main(words: list[str]) -> int:
    """Make an archive for each target, each in a process of its own; returns the exit code.

    words: the folder, if not that of the engine, and the names of targets, if not all; that of the page is `wasm`
    """
    folder, *names = words or [str(FOLDER)]
    Path(folder).mkdir(exist_ok=True)
    if not names or WASM in names:
        code = "from bench.publish import shipped; shipped.make_module()"
        subprocess.run([sys.executable, "-c", code, folder], check=True)
        print(f"{folder}/{ARCHIVE.name}: {(Path(folder) / ARCHIVE.name).stat().st_size / 1e3:.0f} kB", flush=True)
    for target in TARGETS:
        if names and target.name not in names:
            continue
        features = ",".join(f"+{name}" for name in target.features)
        told = {} if target.name in CROSS else {"NUMBA_CPU_NAME": target.name, "NUMBA_CPU_FEATURES": features}
        code = "from bench.publish import shipped; shipped.make_archive()"
        subprocess.run([sys.executable, "-c", code, target.name, folder], env=os.environ | told, check=True)
        path = Path(folder) / archive(target).name
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB", flush=True)
    if Path(folder) == FOLDER:
        stale.mark_pages()  # tables that measured the kernels before these are older now
    return 0


def make_module() -> None:
    """Compile the kernels of pages, and write their archive into the folder that the command line names. It takes six
    minutes and 5 GB."""
    import llvmlite
    import numba

    about: About = {"sources": cache.source_digest()}  # before all else: a source may be edited meanwhile
    about["made_with"] = [numba.__version__, llvmlite.__version__]
    members = {ABOUT: json.dumps(about, indent=1).encode()}
    for order in (2, 4):  # with one step a sample, and with stages
        scene = Scene.model_validate(SIMPLE | {"accuracy": {"order": order}})
        player = player_of_scene(scene, 44_100, KernelName.GENERAL)
        members[general_module_of(player)] = compile_module(requests_of(player.memory.kinds))
    write_archive(Path(sys.argv[1]) / ARCHIVE.name, members)


def make_archive() -> None:
    """Compile all for the target that the command line names, and write its archive into the folder that it names."""
    import llvmlite
    import numba

    from engine.compiler.kernel_compiler import compile_kernel

    target, folder = next(target for target in TARGETS if target.name == sys.argv[1]), Path(sys.argv[2])
    about: About = {"sources": cache.source_digest(), "target": target.name, "features": target.features}
    about["made_with"] = [numba.__version__, llvmlite.__version__]
    if target.name in CROSS:
        members = {member_name(*request): cross_compile(request, CROSS[target.name]) for request in callable_in_c()}
    else:
        members = {member_name(*request): compile_kernel(*request) for request in requests()}
    write_archive(folder / archive(target).name, {ABOUT: json.dumps(about, indent=1).encode(), **members})


def callable_in_c() -> list[Request]:
    """The kernels that need neither numbers of floating point nor a result: others, two small ones of live sound, are
    compiled at their first use on a machine that an archive was made for on another."""
    return [(m, f, kinds) for m, f, kinds in requests() if FLOAT not in kinds and f != PORTAUDIO_CALLBACK.function]


def cross_compile(request: Request, target: machine_code.Target) -> bytes:
    """Compile a kernel for another machine than this one. Return the bytes that engine.compiler.code_objects loads."""
    _, function, _ = request
    code = {function: machine_code.neutral_code(*request)}
    return to_content(function, [], machine_code.object_code(code, target, {}))


def write_archive(path: Path, members: dict[str, bytes]) -> None:
    """Write members to an archive, compressed."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        for name, content in members.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), content, zipfile.ZIP_DEFLATED, 9)
