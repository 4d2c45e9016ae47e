"""Make the machine code that comes with the engine (engine.compiler.shipped), from the sources."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

from engine.build.build import build
from engine.build.general import generalise
from engine.compiler import cache
from engine.compiler.kernel_name import KernelName
from engine.compiler.kinds import Kind
from engine.compiler.shipped import ABOUT, FOLDER, TARGETS, archive, member_name
from engine.live.audio_memory import INSERT_USE
from engine.live.kernels import KINDS
from engine.parallel.helpers import HELP_CREW, HELP_CREW_KINDS
from engine.parallel.job_memory import RENDER_JOB, RENDER_JOB_KINDS, RENDER_USE
from engine.parallel.kernel_choice import Prepared, kinds_of
from engine.patch.scene import Scene

EPOCH = (1980, 1, 1, 0, 0, 0)  # of all members, so that the same sources make the same archive
SIMPLE = {
    "body": [{"name": "a", "kind": "oscillator", "mass": 1.0, "frequency": 100.0, "displacement": 1.0}],
    "contact": [{"body": "a", "barrier": 0.0, "stiffness": 1e6, "exponent": 1.0}],
    "pickup": [{"body": "a"}],
}
Request = tuple[str, str, tuple[Kind, ...]]


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


def run() -> int:
    """Make an archive for each target, each in a process of its own; returns the exit code."""
    FOLDER.mkdir(exist_ok=True)
    for target in TARGETS:
        told = {"NUMBA_CPU_NAME": target.name, "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in target.features)}
        words = [sys.executable, "-c", "from bench.publish import shipped; shipped.make_archive()", target.name]
        subprocess.run(words, env=os.environ | told, check=True)
        print(f"{archive(target)}: {archive(target).stat().st_size / 1e3:.0f} kB", flush=True)
    return 0


def make_archive() -> None:
    """Compile all for the target that the command line names, and write its archive."""
    from engine.compiler.kernel_compiler import compile_kernel

    target = next(target for target in TARGETS if target.name == sys.argv[1])
    members = {member_name(*request): compile_kernel(*request) for request in requests()}
    about = {"sources": cache.source_digest(), "target": target.name, "features": target.features}
    write_archive(archive(target), {ABOUT: json.dumps(about, indent=1).encode(), **members})


def write_archive(path: Path, members: dict[str, bytes]) -> None:
    """Write members to an archive, compressed."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        for name, content in members.items():
            file.writestr(zipfile.ZipInfo(name, EPOCH), content, zipfile.ZIP_DEFLATED, 9)
