"""The folder of compiled kernels, for the tests of it."""

import ctypes
import hashlib
import os
import tempfile
from pathlib import Path

import pytest
from conftest import ROOT

from engine.compiler import cache, shipped
from engine.compiler.decorators import kernel
from engine.compiler.kernel_compiler import compile_kernel
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import FLOAT, INT, kind_of

PATCH = str(ROOT / "patches" / "repelled_oscillator.toml")


@pytest.fixture
def fresh(monkeypatch):
    """Forgets what this process knows of folders, before and after."""
    shipped.fitting_archive()  # or the result of its trial would be among the files
    caches = (cache.kernel_folder, cache.digest, cache.source_digest, cache.warn_once)
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


@kernel
def twice(x):
    return x + x


@kernel
def thrice(x):
    return x + x + x


TWICE = "kernel_files", "twice"
C_TYPES = {INT: ctypes.c_ssize_t, FLOAT: ctypes.c_double}


def function_of(kernel: Kernel, kind: str):
    """Return a kernel of one number as a function of Python."""
    return ctypes.CFUNCTYPE(C_TYPES[kind], C_TYPES[kind])(kernel.address(kind))


def start(argument=1.5) -> bool:
    """Use a kernel as a new process would; whether it was loaded, and not compiled."""
    cache.kernel_folder.cache_clear()
    used, kind = Kernel(*TWICE), kind_of(argument)
    loaded = used.is_ready(kind)
    assert function_of(used, kind)(argument) == 2 * argument
    return loaded


def planted() -> bytes:
    """A file that is whole, and in the place of the kernel, but runs another function."""
    return sealed(cache.key(*TWICE, (FLOAT,)) + b"\n" + compile_kernel("kernel_files", "thrice", (FLOAT,)))


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


def sealed(content: bytes) -> bytes:
    """Content with its digest, as a file has it."""
    return hashlib.sha256(content).digest() + content
