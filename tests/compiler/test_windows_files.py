"""Files of kernels on Windows, by fakes of its calls: locks there keep others from reading, and files that are open
from being replaced."""

import os
import sys
from types import SimpleNamespace

import pytest

from engine.compiler import background, cache_files


@pytest.fixture
def mandatory(tmp_path, monkeypatch):
    """Locks as Windows has them, of two processes: a byte that one has locked, the other neither locks nor reads."""
    locked = {}

    def locking(number, mode, count):
        place = os.lseek(number, 0, os.SEEK_CUR)
        if place in locked:
            raise PermissionError(13, "Permission denied")
        locked[place] = number

    monkeypatch.setattr(cache_files, "folder", lambda: tmp_path)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=locking))
    return locked


def test_the_text_of_a_lock_is_not_what_is_locked(mandatory, tmp_path):
    """So that another process reads that kernels are being compiled, and starts no second compiler."""
    lock = background._take_lock(background.COMPILING)
    assert lock is not None and background._take_lock() is None
    text = tmp_path.joinpath(background.LOCK).read_text("utf-8")
    assert text == background.COMPILING and min(mandatory) > len(text)
    assert background.is_compiling()
    os.close(lock)


def test_two_processes_that_keep_the_same_kernel(tmp_path, monkeypatch):
    """The second cannot replace the file of the first, which has the same content: that is no failure."""
    path, replace = tmp_path / f"kernel{cache_files.KERNEL}", os.replace
    cache_files.write(path, b"code")

    def refuse(source, target):
        raise PermissionError(13, "Access is denied")

    monkeypatch.setattr(os, "replace", refuse)
    cache_files.write(path, b"code")
    assert cache_files.read(path) == b"code" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(PermissionError):
        cache_files.write(path, b"other code")
    monkeypatch.setattr(os, "replace", replace)
    assert cache_files.read(path) == b"code" and list(tmp_path.iterdir()) == [path]
