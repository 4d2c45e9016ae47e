"""The folder of compiled kernels, for the tests of it."""

import hashlib
import os
import tempfile
from pathlib import Path

import pytest
from conftest import ROOT

from engine.compiler import cache
from engine.compiler.decorators import kernel

PATCH = str(ROOT / "patches" / "repelled_oscillator.toml")


@pytest.fixture
def fresh(monkeypatch):
    """Forgets what this process knows of folders, before and after."""
    caches = (cache.kernel_folder, cache.digest, cache.warn_once)
    for function in caches:
        function.cache_clear()
    yield
    for function in caches:
        function.cache_clear()


@pytest.fixture
def base(fresh, tmp_path, monkeypatch):
    """The folder of all kernels, which is empty."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    return tmp_path / "cache" / "fdh-engine"


@pytest.fixture
def temporary(fresh, tmp_path, monkeypatch):
    """The folder of kernels of a user who has no cache folder; it is not there yet."""
    (tmp_path / "file").touch()
    (tmp_path / "shared").mkdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "shared"))
    return tmp_path / "shared" / f"fdh-engine-{os.geteuid()}"


def twice(x):
    return x + x


def start(argument=1.5) -> bool:
    """Use a kernel as a new process would; whether it was loaded, and not compiled."""
    cache.kernel_folder.cache_clear()
    dispatcher = kernel(twice)
    assert dispatcher(argument) == 2 * argument
    return bool(dispatcher.stats.cache_hits)


def kept(base: Path) -> list[Path]:
    """All files in a folder."""
    return sorted(path for path in base.rglob("*") if not path.is_dir())


def only(base: Path) -> Path:
    """The one file in a folder."""
    (path,) = kept(base)
    return path


def heals(base: Path) -> None:
    """The next start compiles, the one after it loads."""
    assert not start()
    assert start()
    assert only(base).suffix == ".nbc"


class Runs:
    """A pickle that makes a file when it is loaded."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def sealed(content: bytes) -> bytes:
    """Content with its digest, as a file has it."""
    return hashlib.sha256(content).digest() + content
