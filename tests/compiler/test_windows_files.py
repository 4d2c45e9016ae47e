"""Files of kernels on Windows, by fakes of its calls: a file that is open cannot be replaced."""

import os

import pytest

from engine.compiler import cache_files


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
