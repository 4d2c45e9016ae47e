"""Compiled kernels are compiled again when sources, compiler or processor change."""

import shutil
from types import SimpleNamespace

import llvmlite.binding
import pytest
from conftest import ROOT

from engine.compiler import cache


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
