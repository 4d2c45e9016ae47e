"""Compiled kernels are compiled again when sources, compiler or processor change."""

import shutil
from types import SimpleNamespace

import llvmlite.binding
import numba
import pytest
from conftest import ROOT

from engine.compiler import cache
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import INT
from engine.faults import BuildError


@pytest.mark.hard
def test_the_digest_is_of_all_kernel_sources(fresh, tmp_path, monkeypatch):
    shutil.copytree(ROOT / "engine", tmp_path / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(cache, "__file__", str(tmp_path / "engine" / "compiler" / "cache.py"))

    def digest() -> str:
        cache.digest.cache_clear()
        cache.source_digest.cache_clear()
        return cache.digest()

    deep, deeper = tmp_path / "engine" / "bodies_of" / "deep.py", tmp_path / "engine" / "others" / "deep.py"
    found = [digest()]
    deep.parent.mkdir()
    deep.write_text("from engine.compiler.decorators import inline\n")
    found.append(digest())
    deep.write_text("from engine.compiler.decorators import inline\nX = 1\n")
    found.append(digest())
    deeper.parent.mkdir()
    deep.rename(deeper)
    found.append(digest())
    assert len(set(found)) == 4
    deep.write_text("import json\n")
    assert digest() == found[-1]


@pytest.mark.parametrize("package", ["numba", "llvmlite"])
def test_the_digest_is_of_the_compiler(fresh, monkeypatch, package):
    before = cache.digest()
    cache.digest.cache_clear()
    version = cache.package_version
    monkeypatch.setattr(cache, "package_version", lambda name: "0" if name == package else version(name))
    assert cache.digest()[:16] != before[:16]


def test_the_digest_is_of_the_version_of_numpy(fresh, monkeypatch):
    before = cache.digest()
    cache.digest.cache_clear()
    monkeypatch.setattr(cache.np, "__version__", "0")
    assert cache.digest()[:16] != before[:16]


@pytest.mark.parametrize("what", ["get_host_cpu_name", "get_host_cpu_features"])
def test_the_digest_is_of_the_processor(fresh, monkeypatch, what):
    before = cache.digest()
    cache.digest.cache_clear()
    found = {"get_host_cpu_name": "i486", "get_host_cpu_features": SimpleNamespace(flatten=lambda: "+fpu")}[what]
    monkeypatch.setattr(llvmlite.binding, what, lambda: found)
    after = cache.digest()
    assert after[:17] == before[:17] and after[17:] != before[17:]


def test_the_digest_is_of_what_numba_is_told(fresh, monkeypatch):
    before = cache.digest()
    cache.digest.cache_clear()
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    assert cache.digest()[17:] != before[17:]


@pytest.mark.parametrize("name", cache.OF_MACHINE_CODE)
def test_the_digest_is_of_settings_that_reach_the_code_generator(fresh, monkeypatch, name):
    """A kernel that was compiled under NUMBA_OPT=0 is 50 times slower, and is not used without it."""
    monkeypatch.delenv(name, raising=False)
    before = cache.digest()
    cache.digest.cache_clear()
    monkeypatch.setenv(name, "0")
    after = cache.digest()
    assert after[:17] == before[:17] and after[17:] != before[17:]


def test_the_digest_is_of_the_file_that_numba_reads(fresh, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = cache.digest()
    cache.digest.cache_clear()
    (tmp_path / ".numba_config.yaml").write_text("opt: 0")
    assert cache.digest()[17:] != before[17:]


def test_a_numba_that_compiles_nothing_is_said_in_one_line(fresh, monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    with pytest.raises(BuildError, match=r"NUMBA_DISABLE_JIT is set, .*: kernels cannot be compiled; unset it"):
        Kernel("engine.runtime.partitions", "help_crew")._compile((INT,))
