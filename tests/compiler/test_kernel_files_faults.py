"""Compiled kernels shared by several processes, and on disks that are full or cannot be written to."""

import errno
import os
import subprocess
import sys
import tempfile
import time

import pytest
from conftest import ROOT
from kernel_files import heals, kept, only, start

from engine.compiler import cache, cache_files

SMALL = """
import sys
from engine.compiler.decorators import kernel
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import FLOAT, INT

@kernel
def total(x, y):
    return x + y

if __name__ == "__main__":
    kinds = [(FLOAT, FLOAT), (INT, INT), (INT, FLOAT)][:: int(sys.argv[1])]
    used = Kernel("small", "total")
    ready = [used.is_ready(*pair) for pair in kinds]
    assert all(used.address(*pair) for pair in kinds)
    print(sum(ready))
"""

resource = pytest.importorskip("resource", reason="Windows has no owners of this kind")


@pytest.mark.hard
def test_processes_that_compile_the_same_at_once(tmp_path):
    (tmp_path / "small.py").write_text(SMALL)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def process(way: int) -> subprocess.Popen:
        words = [sys.executable, "small.py", str(way)]
        return subprocess.Popen(
            words, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    for _, stderr in [p.communicate() for p in [process(way) for way in (1, -1, 1, -1)]]:
        assert stderr == ""
    files = kept(tmp_path / "cache")
    assert {path.suffix for path in files} <= {".nbc", ".trial"}  # no part of a file is left
    assert sum(path.suffix == ".nbc" for path in files) == 3
    assert process(1).communicate() == ("3\n", "")


@pytest.mark.parametrize("code", [errno.EROFS, errno.EACCES, errno.ENOSPC, errno.EDQUOT])
def test_a_file_that_cannot_be_made(base, monkeypatch, capsys, code):
    def fail(*_, **__):
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as patched:
        patched.setattr(tempfile, "mkstemp", fail)
        assert not start() and not start()
        said = capsys.readouterr().err
        assert len(said.splitlines()) == 1 and os.strerror(code) in said
    assert not kept(base)
    heals(base)


def test_a_file_that_can_be_written_in_part(base, capsys):
    """As on a full disk: the limit on the size of files stops a write after some bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        assert not start()
        assert kept(base) == []
        with pytest.raises(OSError):
            cache_files.write(base / cache.digest() / "a.nbc", bytes(5000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "cannot be kept" in capsys.readouterr().err
    heals(base)


def test_a_damaged_file_that_can_be_neither_deleted_nor_replaced(base, monkeypatch, capsys):
    start()
    only(base).write_bytes(b"damaged")

    def fail(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    with monkeypatch.context() as patched:
        for name in ("unlink", "replace", "utime"):
            patched.setattr(os, name, fail)
        patched.setattr(tempfile, "mkstemp", fail)
        assert not start()
    assert "cannot be kept" in capsys.readouterr().err
    heals(base)


def test_a_folder_that_has_become_read_only_is_read(base, monkeypatch, capsys):
    start()

    def fail(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for name in ("mkdir", "utime", "unlink", "rmdir", "replace"):
        monkeypatch.setattr(os, name, fail)
    assert start()
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder(base):
    start()
    only(base).parent.chmod(0o500)
    try:
        assert start()
        assert not start(3)
    finally:
        only(base).parent.chmod(0o700)
    assert not start(3) and start(3)


def test_a_process_that_is_killed_while_it_writes(base):
    """What it leaves is deleted after an hour, for another process may be writing it."""
    start()
    young, old = (only(base).parent / f"{name}.tmp" for name in ("young", "old"))
    for path in (young, old):
        path.write_bytes(b"half")
    os.utime(old, (time.time() - 4000,) * 2)
    assert start()
    assert young.exists() and not old.exists()
