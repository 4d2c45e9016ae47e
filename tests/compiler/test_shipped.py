"""The machine code that comes with the engine: of the present sources, of the right form, and with the same samples."""

import json
import os
import platform
import shlex
import subprocess
import sys
import zipfile

import llvmlite.binding
import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.compiler import cache, shipped
from engine.compiler.shipped import ABOUT, TARGETS, archive
from engine.runtime.job_memory import RENDER_BLOCK

NAMES = [target.name for target in TARGETS]
ELF, MACHINES = b"\x7fELF\x02\x01", {"x86-64-v3": 0x3E, "x86-64": 0x3E, "aarch64": 0xB7}


@pytest.fixture
def fresh_choice(monkeypatch):
    """Forgets which archive was chosen, before and after; and no kernel is on this machine."""
    shipped._fitting_archive.cache_clear()
    monkeypatch.setattr("engine.compiler.kernels.cache.read_kernel", lambda *_: None)
    monkeypatch.setattr(RENDER_BLOCK, "_loaded", {})
    yield
    shipped._fitting_archive.cache_clear()


def target_named(name: str) -> shipped.Target:
    return next(target for target in TARGETS if target.name == name)


def skip_if_stale() -> None:
    """While kernels are edited, archives are of older sources, and not used; they are made anew once, at the end."""
    if any(shipped.sources_of(archive(target)) != cache.source_digest() for target in TARGETS):
        pytest.skip("made from other sources, so not used; `python -m bench shipped` makes them anew")


@pytest.mark.parametrize("name", NAMES)
def test_it_is_used_if_it_is_of_the_present_sources(name, fresh_choice, monkeypatch):
    skip_if_stale()
    if not supported(name) or sys.platform != "linux":
        pytest.skip("another processor")
    monkeypatch.setattr(shipped, "TARGETS", (target_named(name),))
    assert shipped._fitting_archive() == archive(target_named(name))


@pytest.mark.parametrize("name", NAMES)
def test_it_is_machine_code_of_its_target(name):
    with zipfile.ZipFile(archive(target_named(name))) as file:
        about = json.loads(file.read(ABOUT))
        members = [file.read(member) for member in file.namelist() if member != ABOUT]
    assert about["target"] == name and len(members) >= 8
    for content in members:
        header, _, code = content.partition(b"\n")
        assert json.loads(header)["symbol"].encode() in code
        assert code.startswith(ELF) and int.from_bytes(code[18:20], "little") == MACHINES[name]


def supported(name: str) -> bool:
    features, target = llvmlite.binding.get_host_cpu_features(), target_named(name)
    return platform.machine().lower() in target.machines and all(map(features.get, target.features))


@pytest.mark.hard
@pytest.mark.parametrize("name", NAMES)
def test_its_samples_are_those_of_a_special_kernel(patch, name, fresh_choice, monkeypatch):
    if not supported(name):
        pytest.skip("another processor")
    monkeypatch.setattr(shipped, "TARGETS", (target_named(name),))
    scene = patch("bouncing_ball")
    general = engine.render(scene, 0.5, kernel="general").audio
    assert engine.render(scene, 0.5, kernel="special").audio.tobytes() == general.tobytes()


@pytest.mark.parametrize(
    ("lacking", "chosen"), [("fma", "x86-64"), ("avx2", "x86-64"), ("none", "x86-64-v3")], ids=lambda word: word
)
def test_the_best_that_fits_the_processor_is_chosen(fresh_choice, monkeypatch, lacking, chosen):
    skip_if_stale()
    if not supported("x86-64-v3") or sys.platform != "linux":
        pytest.skip("another processor")
    features = dict(llvmlite.binding.get_host_cpu_features()) | {lacking: False}
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_features", lambda: features)
    assert shipped._fitting_archive() == archive(target_named(chosen))


@pytest.mark.parametrize("kind", ["other sources", "damaged", "gone", "no zip"])
def test_what_does_not_fit_is_not_used(tmp_path, fresh_choice, monkeypatch, kind):
    for target in TARGETS:
        content = archive(target).read_bytes()
        path = tmp_path / archive(target).name
        path.write_bytes({"damaged": content[: len(content) // 2], "no zip": b"none"}.get(kind, content))
        if kind == "gone":
            path.unlink()
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    if kind == "other sources":
        monkeypatch.setattr(cache, "source_digest", lambda: "other")
    assert shipped.read_shipped("engine.runtime.partitions", "render_job", ("int", "int")) is None


def test_a_trick_that_is_switched_off_is_compiled(fresh_choice, monkeypatch):
    monkeypatch.setattr(shipped, "switched_off", lambda: {"lanes"})
    assert shipped._fitting_archive() is None


@pytest.mark.slow  # nine minutes of compiling
def test_the_same_sources_make_the_same_bytes(tmp_path):
    skip_if_stale()
    import llvmlite
    import numba

    target = TARGETS[0]
    with zipfile.ZipFile(archive(target)) as file:
        about = json.loads(file.read(ABOUT))
    if about["made_with"] != [numba.__version__, llvmlite.__version__]:
        pytest.skip("made with another compiler")
    words = [sys.executable, "-m", "bench", "shipped", str(tmp_path), target.name]
    subprocess.run(words, cwd=ROOT, check=True, capture_output=True)
    assert (tmp_path / archive(target).name).read_bytes() == archive(target).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["piano_c4", "guitar_body", "slack_bass", "bowed_vibraphone", "tanpura"])
def test_the_samples_of_aarch64_are_the_same(name, tmp_path):
    """But for the last bits of the tables, whose sines and sums NumPy takes otherwise there. Without Numba. Another
    Python plays, such as one under qemu-aarch64; libraries in C hold the bits of the same code."""
    command = os.environ.get("FDH_AARCH64_PYTHON")
    if not command:
        pytest.skip("FDH_AARCH64_PYTHON is no command of a Python for aarch64 that has the engine's packages")
    code = (
        "import sys, engine; "
        f"audio = engine.render(engine.load({name!r}), 0.1, kernel='general', cores=1).audio; "
        "assert 'numba' not in sys.modules; sys.stdout.buffer.write(audio.tobytes())"
    )
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    run = [*shlex.split(command), "-c", code]
    played = subprocess.run(run, cwd=ROOT, env=environment, check=True, capture_output=True).stdout
    audio = engine.render(engine.load(name), 0.1, kernel="general", cores=1).audio
    difference = np.abs(np.frombuffer(played).reshape(audio.shape) - audio).max()
    assert np.abs(audio).max() > 0.0 and difference <= 1e-9 * np.abs(audio).max()
