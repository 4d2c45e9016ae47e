"""The machine code that comes with the engine: of the present sources, of the right form, and with the same samples."""

import os
import platform
import shlex
import subprocess
import sys

import llvmlite.binding
import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.assembly.table_digest import read_shipped_digests
from engine.compiler import archive_trial, cache, shipped
from engine.compiler.archive_trial import PASSED
from engine.compiler.shipped import archive, read_about, read_part
from engine.compiler.targets import TARGETS, WASM, fitting_targets, is_of_family, target_named
from engine.runtime.job_memory import RENDER_BLOCK

NAMES = [target.name for target in TARGETS]
MB = 1_000_000
WITHOUT_INSTRUCTION = {"fma", "floor"}  # functions of C that the least processors of x86-64 call


@pytest.fixture
def fresh_choice(monkeypatch):
    """Forgets which archive was chosen, before and after; and no kernel is on this machine."""
    shipped.fitting_archive.cache_clear()
    monkeypatch.setattr("engine.compiler.kernels.cache.read_kernel", lambda *_: None)
    monkeypatch.setattr(RENDER_BLOCK, "_loaded", {})
    yield
    shipped.fitting_archive.cache_clear()


def skip_if_stale() -> None:
    """While kernels are edited, archives are of older sources, and not used; they are made anew once, at the end, which
    CI looks after (.ci/run)."""
    if any(shipped.sources_of(archive(target)) != cache.source_digest() for target in TARGETS):
        pytest.skip("made from other sources, so not used; `python -m bench shipped` makes them anew")


def use_only(name, monkeypatch):
    """Let there be no other archive than that of a target, which this machine can run."""
    target = target_named(name)
    if target not in fitting_targets():
        pytest.skip("another processor")
    monkeypatch.setattr(shipped, "fitting_targets", lambda: [target])


@pytest.mark.parametrize("name", NAMES)
def test_it_is_used_if_it_is_of_the_present_sources(name, fresh_choice, monkeypatch):
    skip_if_stale()
    use_only(name, monkeypatch)
    assert shipped.fitting_archive() == archive(target_named(name))


def test_all_together_are_small():
    sizes = [archive(target).stat().st_size for target in (*TARGETS, WASM)]
    assert len(sizes) == 9 and sum(sizes) < 3 * MB


@pytest.mark.hard
@pytest.mark.parametrize("name", NAMES)
def test_its_samples_are_those_of_a_special_kernel(patch, name, fresh_choice, monkeypatch):
    use_only(name, monkeypatch)
    scene = patch("bouncing_ball")
    general = engine.render(scene, 0.5, kernel="general").audio
    assert engine.render(scene, 0.5, kernel="special").audio.tobytes() == general.tobytes()


@pytest.mark.parametrize(
    ("lacking", "chosen"),
    [
        ("fma", "linux-x86-64"),
        ("avx2", "linux-x86-64"),
        ("avx512vl", "linux-x86-64-v3"),
        ("none", "linux-x86-64-v4"),
    ],
)
def test_the_best_that_fits_the_processor_is_chosen(fresh_choice, monkeypatch, lacking, chosen):
    skip_if_stale()
    if not is_of_family(target_named(chosen)):
        pytest.skip("another family of processors")
    features = dict.fromkeys(target_named("linux-x86-64-v4").needed, True) | {lacking: False}
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(shipped, "result_of_trial", lambda _: PASSED)  # this processor may not have it
    assert shipped.fitting_archive() == archive(target_named(chosen))


@pytest.mark.parametrize(
    ("system", "machine", "best"),
    [
        ("darwin", "arm64", "macos-arm64"),
        ("darwin", "x86_64", "macos-x86-64-v3"),
        ("win32", "AMD64", "windows-x86-64-v4"),
        ("linux", "aarch64", "linux-aarch64"),
        ("linux", "riscv64", None),
    ],
)
def test_each_system_has_its_own(fresh_choice, monkeypatch, system, machine, best):
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    features = dict.fromkeys(target_named("linux-x86-64-v4").needed, True)
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_features", lambda: features)
    assert next((target.name for target in fitting_targets()), None) == best


@pytest.mark.parametrize("kind", ["other sources", "damaged", "gone", "no archive"])
def test_what_does_not_fit_is_not_used(tmp_path, fresh_choice, monkeypatch, kind):
    for target in TARGETS:
        content = archive(target).read_bytes()
        path = tmp_path / archive(target).name
        path.write_bytes({"damaged": content[: len(content) // 2], "no archive": b"none"}.get(kind, content))
        if kind == "gone":
            path.unlink()
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    if kind == "other sources":
        monkeypatch.setattr(cache, "source_digest", lambda: "other")
    assert shipped.load_shipped("engine.runtime.partitions", "render_job", ("int", "int")) is None


def test_a_trick_that_is_switched_off_is_compiled(fresh_choice, monkeypatch):
    monkeypatch.setattr(shipped, "switched_off", lambda: {"lanes"})
    assert shipped.fitting_archive() is None


# --- the form


def lief_object(name, part):
    """Return an object file of an archive, read by another program, and its functions."""
    lief = pytest.importorskip("lief")
    content = read_part(archive(target_named(name)), part)
    readers = {"linux": lief.ELF.parse, "macos": lief.MachO.parse, "windows": lief.COFF.parse}
    read = readers[name.partition("-")[0]](content.machine_code)
    return (read.at(0) if name.startswith("macos") else read), content


@pytest.mark.parametrize("part", ["plain.o", "stages.o"])
@pytest.mark.parametrize("name", NAMES)
def test_it_needs_nothing_from_outside(name, part):
    """No function of Python, of Numba or of the C library, so that a linker takes it as it is."""
    read, content = lief_object(name, part)
    assert content.needed == []
    names, undefined = {str(symbol.name).lstrip("_") for symbol in read.symbols}, set()
    for symbol in read.symbols:
        if name.startswith("linux"):
            is_undefined = symbol.shndx == 0 and symbol.name
        elif name.startswith("macos"):
            is_undefined = not symbol.numberof_sections
        else:
            is_undefined = symbol.section_idx == 0
        undefined |= {str(symbol.name).lstrip("_")} if is_undefined else set()
    assert set(content.functions) <= names
    assert undefined <= (WITHOUT_INSTRUCTION if name == "linux-x86-64" else set())


@pytest.mark.parametrize("part", ["plain.o", "stages.o"])
@pytest.mark.parametrize("name", NAMES)
def test_it_is_machine_code_of_its_target(name, part):
    _, content = lief_object(name, part)
    code = content.machine_code
    arm = "aarch64" in name or "arm64" in name
    if name.startswith("linux"):
        assert code.startswith(b"\x7fELF\x02\x01") and int.from_bytes(code[18:20], "little") == (0xB7 if arm else 0x3E)
    elif name.startswith("macos"):
        assert code.startswith(b"\xcf\xfa\xed\xfe") and code[4:8].hex() == ("0c000001" if arm else "07000001")
    else:
        assert code.startswith(b"\x64\x86")


@pytest.mark.slow  # a quarter of an hour of compiling
def test_the_same_sources_make_the_same_bytes(tmp_path):
    skip_if_stale()
    import llvmlite
    import numba

    if read_about(archive(TARGETS[0]))["made_with"] != [numba.__version__, llvmlite.__version__]:
        pytest.skip("made with another compiler")
    copied = tmp_path / "copied"
    subprocess.run(["git", "clone", "-q", ROOT, copied], check=True)
    subprocess.run([sys.executable, "-m", "bench", "shipped"], cwd=copied, check=True, capture_output=True)
    for target in TARGETS:
        assert (copied / "engine/shipped" / archive(target).name).read_bytes() == archive(target).read_bytes()


# --- a Python for aarch64, such as one under qemu-aarch64 (CONTRIBUTING.md)


def run_on_aarch64(code, tmp_path):
    """Return what a Python for aarch64 writes; it takes the archive without a trial, as it cannot start itself."""
    command = os.environ.get("FDH_AARCH64_PYTHON")
    if not command:
        pytest.skip("FDH_AARCH64_PYTHON is no command of a Python for aarch64 that has the engine's packages")
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {archive_trial.TRIED: str(archive(target_named("linux-aarch64")))}
    run = [*shlex.split(command), "-c", code]
    return subprocess.run(run, cwd=ROOT, env=environment, check=True, capture_output=True).stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", ["piano_c4", "guitar_body", "slack_bass", "bowed_vibraphone", "tanpura", "snare"])
def test_the_samples_of_aarch64_are_the_same(name, tmp_path):
    """To the last bit, and without Numba."""
    code = (
        "import sys, engine; "
        f"audio = engine.render(engine.load({name!r}), 0.1, kernel='general', cores=1).audio; "
        "assert 'numba' not in sys.modules; sys.stdout.buffer.write(audio.tobytes())"
    )
    played = run_on_aarch64(code, tmp_path)
    audio = engine.render(engine.load(name), 0.1, kernel="general", cores=1).audio
    assert np.abs(audio).max() > 0.0
    np.testing.assert_array_equal(np.frombuffer(played).reshape(audio.shape), audio)


@pytest.mark.slow
def test_the_tables_of_aarch64_are_the_same(tmp_path):
    """Those of all shipped patches, but of one with noise in a band, which SciPy filters."""
    published = read_shipped_digests()
    code = (
        "import engine; from engine.assembly.table_digest import digest_scene; "
        f"[print(name, digest_scene(engine.load(name)), flush=True) for name in {list(published)!r}]"
    )
    computed = dict(line.split() for line in run_on_aarch64(code, tmp_path).decode().splitlines())
    different = {name for name, digest in published.items() if computed[name] != digest}
    assert len(computed) == len(published) > 40 and different <= {"scraped_stick"}
