"""Make the machine code that comes with the engine (engine.compiler.shipped), from the sources.

`uv run python -m bench shipped [NAME …]`: for all targets, or those named, such as `linux-x86-64-v3` or `wasm32`;
`… bench shipped --check`: end with 1 if an archive is of other sources. Numba compiles each kernel once to LLVM's
intermediate code, those without stages in one process and those with stages in another; from this all objects are made,
for each target in a process of its own. It takes a quarter of an hour and 6 GB.
"""

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.publish import stale
from engine.assembly.build import build
from engine.compiler import archive_trial, cache
from engine.compiler.kinds import Kind
from engine.compiler.shipped import ABOUT, FOLDER, SAMPLES, archive, kernel_key, sources_of, write_members
from engine.compiler.targets import TARGETS, WASM, Target, fitting_targets, target_named
from engine.export.player_bytes import INSERT, PLAY, RENDER
from engine.export.wasm_kernels import GENERAL, REFINED
from engine.live.kernels import KINDS, PLAY_INTO
from engine.patch.scene import Scene
from engine.runtime.exchange import INSERT_USE
from engine.runtime.helpers import HELP_CREW, HELP_CREW_KINDS
from engine.runtime.job_memory import RENDER_JOB, RENDER_JOB_KINDS, RENDER_USE
from engine.runtime.kernel_choice import prepare

SIMPLE = {
    "body": [{"name": "a", "kind": "oscillator", "mass": 1.0, "frequency": 100.0, "displacement": 1.0}],
    "contact": [{"body": "a", "barrier": 0.0, "stiffness": 1e6, "exponent": 1.0}],
    "pickup": [{"body": "a"}],
}
PLAIN, STAGES = "plain", "stages"  # parts: of scenes with one step a sample and of all else, and with stages
ORDERS = {PLAIN: 2, STAGES: 4}
MODULES = {GENERAL: PLAIN, REFINED: STAGES}
OF_PAGES = {PLAY: PLAY_INTO.function, RENDER: RENDER_USE.kernel.function, INSERT: INSERT_USE.kernel.function}
Request = tuple[str, str, tuple[Kind, ...]]


def requests(part: str) -> dict[str, Request]:
    """Return the kernels of a part: module, function and kinds, by their names in C."""
    scene = Scene.model_validate(SIMPLE | {"accuracy": {"order": ORDERS[part]}})
    model, state, _ = build(scene, 44_100)
    general = prepare([model], state)
    wanted = [(use.kernel, general.kinds_for(use)) for use in (RENDER_USE, INSERT_USE)]
    if part == PLAIN:
        wanted += [(RENDER_JOB, RENDER_JOB_KINDS), (HELP_CREW, HELP_CREW_KINDS), *KINDS.items()]
    end = "" if part == PLAIN else f"_{part}"
    return {f"fdh_{kernel.function}{end}": (kernel.module, kernel.function, kinds) for kernel, kinds in wanted}


def main(words: list[str]) -> int:
    """Make the archives; returns the exit code."""
    if words == ["--check"]:
        return check()
    targets = [target_named(name) for name in words] or [*TARGETS, WASM]
    digest = cache.source_digest()  # before all else: a source may be edited meanwhile
    with tempfile.TemporaryDirectory() as folder:
        _run_each([["compile_neutral", part, f"{folder}/{part}.pickle"] for part in ORDERS])
        for target in targets:
            _run_each([["make_object", part, folder, target.name] for part in ORDERS])
            write_archive(target, Path(folder), digest, "")
        samples = _digest_samples()
        for target in targets:
            write_archive(target, Path(folder), digest, samples)
            print(f"{archive(target).name}: {archive(target).stat().st_size / 1e3:.0f} kB", flush=True)
    stale.mark_pages()  # tables that measured the kernels before these are older now
    return 0


def check() -> int:
    """Print the archives that do not fit the sources; returns 1 if there are any."""
    old = [target.name for target in (*TARGETS, WASM) if sources_of(archive(target)) != cache.source_digest()]
    if old:
        print(f"made from other sources: {', '.join(old)}; run: python -m bench shipped", file=sys.stderr)
    return 1 if old else 0


def _run_each(calls: Sequence[list[str]]) -> None:
    """Run functions of this module with words, each in a process of its own, all at once. Raises SystemExit if one
    fails."""
    code = f"import sys; from {__spec__.name} import *; globals()[sys.argv[1]](*sys.argv[2:])"
    started = [subprocess.Popen([sys.executable, "-c", code, *words]) for words in calls]
    exit_codes = [process.wait() for process in started]
    if any(exit_codes):
        raise SystemExit("a process failed; nothing more is made")


def compile_neutral(part: str, path: str) -> None:
    """Compile the kernels of a part to intermediate code, and write it to a file."""
    from engine.compiler.machine_code import neutral_code

    codes = [(name, neutral_code(*request)) for name, request in requests(part).items()]
    Path(path).write_bytes(pickle.dumps(codes))


def make_object(part: str, folder: str, target: str) -> None:
    """Make the object of a part for a target from intermediate code, beside that."""
    from engine.compiler.machine_code import object_code
    from engine.compiler.wasm_module import with_exports

    codes = {name: code for one in ORDERS for name, code in pickle.loads((Path(folder) / f"{one}.pickle").read_bytes())}
    chosen = _of_pages(part, codes) if target == WASM.name else {name: codes[name] for name in requests(part)}
    made = object_code(chosen, target_named(target), {})
    content = with_exports(made.content, list(chosen)) if target == WASM.name else made.content
    about = {"functions": list(chosen), "needed": made.needed}
    (Path(folder) / f"{target}-{part}.bin").write_bytes(content)
    (Path(folder) / f"{target}-{part}.json").write_text(json.dumps(about))


def _of_pages(part: str, codes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the code of the kernels of a page, by the names that it calls them. The player is the same in each."""
    end = "" if part == PLAIN else f"_{part}"
    ends = {PLAY: "", RENDER: end, INSERT: end}
    return {name: codes[f"fdh_{function}{ends[name]}"] for name, function in OF_PAGES.items()}


def write_archive(target: Target, folder: Path, digest: str, samples: str) -> None:
    """Write the archive of a target, of objects in a folder. samples: the digest of those of a trial"""
    import llvmlite
    import numba

    files = MODULES if target is WASM else {f"{part}.o": part for part in ORDERS}
    about = {"sources": digest, "target": target.name, "made_with": [numba.__version__, llvmlite.__version__]}
    about |= {SAMPLES: samples, "parts": {}, "kernels": {}}
    for file, part in files.items():
        about["parts"][file] = json.loads((folder / f"{target.name}-{part}.json").read_text())
        if target is not WASM:
            about["kernels"] |= {kernel_key(*request): [file, name] for name, request in requests(part).items()}
    members = {file: (folder / f"{target.name}-{part}.bin").read_bytes() for file, part in files.items()}
    FOLDER.mkdir(exist_ok=True)
    write_members(archive(target), {ABOUT: json.dumps(about, indent=1).encode(), **members})


def _digest_samples() -> str:
    """Return the digest of the samples of a trial, which each archive that this machine can run makes alike. Raises
    SystemExit if they do not, or none is of the present sources."""
    digests = set[str]()
    for target in fitting_targets():
        if sources_of(archive(target)) == cache.source_digest():
            environment = os.environ | {archive_trial.TRIED: str(archive(target))}
            command = [sys.executable, "-m", archive_trial.SCENES]
            digests.add(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)
    if len(digests) != 1:
        raise SystemExit(f"the archives for this machine make {len(digests)} different sounds; there must be one")
    return digests.pop().strip()
