"""The cache of compiled kernels stays small, and a command tells of it and clears it."""

import errno
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT
from kernel_files import TWICE, function_of, kept, only, start

from engine.cli import main
from engine.compiler import cache, cache_files
from engine.compiler.kernels import Kernel
from engine.compiler.kinds import FLOAT, INT


def store(folder: Path, name: str, age: float, size: int = 10_000) -> Path:
    """A file that was used some seconds ago."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    cache_files.write(path, bytes(size - cache_files.DIGEST))
    os.utime(path, (time.time() - age,) * 2)
    return path


def test_what_was_not_used_for_longest_is_deleted_first(base, monkeypatch):
    folder, older = base / ("a" * 16 + "-" + "0" * 8), base / ("b" * 16)
    files = {age: store(older if age > 25 else folder, f"{age}.nbc", age) for age in (10, 20, 30, 40, 50)}
    cache_files.prune(folder, 1e6)
    assert all(path.exists() for path in files.values())
    assert cache_files.read(files[40])  # now it was used
    cache_files.prune(folder, 25_000)
    assert [age for age, path in files.items() if path.exists()] == [10, 40]


def test_the_limit_is_in_the_environment(base, monkeypatch, capsys):
    start()
    size = only(base).stat().st_size
    start(3)
    monkeypatch.setenv("FDH_CACHE_LIMIT", str(1.5 * size / 1e6))
    assert start(3) and only(base)
    assert not start() and only(base)
    assert start()
    monkeypatch.setenv("FDH_CACHE_LIMIT", "0")
    assert not start() and not kept(base)
    monkeypatch.setenv("FDH_CACHE_LIMIT", "much")
    assert capsys.readouterr().err == ""
    assert not start() and start()
    assert capsys.readouterr().err.count('FDH_CACHE_LIMIT: "much" is not a number of MB') == 1
    assert main.main(["cache"]) == 2
    assert 'FDH_CACHE_LIMIT: "much"' in capsys.readouterr().err


def test_folders_of_older_sources_are_deleted(base):
    """Those of the same sources on other processors are not, nor is what is not of this engine."""
    others = [base / (f"{i:016x}" + ("-00000000" if i % 2 else "")) for i in range(6)]
    for i, folder in enumerate(others):
        store(folder, "a.nbc", 100.0 * i)
    store(others[5] / "engine_0123", "a.nbi", 0.0)  # as earlier versions had it
    os.utime(others[5] / "engine_0123" / "a.nbi", (time.time() - 500,) * 2)
    store(base / "notes", "a.nbc", 1e9)
    (others[4] / "mine.txt").touch()
    start()
    same = [store(base / (cache.kernel_folder().name[:17] + f"{i:08x}"), "a.nbc", 1e6) for i in range(6)]
    assert start()
    assert all(path.exists() for path in same)
    assert [folder.exists() for folder in others] == [True, True, True, False, True, False]
    assert kept(others[4]) == [others[4] / "mine.txt"]
    assert kept(base / "notes")


def test_a_process_whose_folder_is_deleted_goes_on(base, monkeypatch):
    used = Kernel(*TWICE)
    first = function_of(used, FLOAT)
    shutil.rmtree(base / cache.kernel_folder().name)
    assert function_of(used, INT)(3) == 6 and first(1.5) == 3.0
    assert only(base)
    replace, gone = os.replace, []

    def late(part, path):
        if not gone:
            gone.append(path)
            shutil.rmtree(Path(path).parent)
        replace(part, path)

    monkeypatch.setattr(os, "replace", late)
    assert not start()
    assert gone and only(base)


# --- the command


def test_the_command_tells_and_clears(base, capsys):
    start()
    start(3)
    old = store(base / "0123456789abcdef" / "engine_0123", "a.nbi", 0.0)
    mine = [base / "mine.txt", old.parent / "mine.txt"]
    for path in mine:
        path.touch()
    size = sum(path.stat().st_size for path in kept(base))
    assert main.main(["cache"]) == 0
    assert capsys.readouterr().out == f"{base}: 2 kernels, {size / 1e6:.1f} MB; at most 500 MB\n"
    assert main.main(["cache", "--json"]) == 0
    told = {"folder": str(base), "kernels": 2, "bytes": size, "limit_bytes": 5e8, "deleted": 0}
    assert json.loads(capsys.readouterr().out) == told
    assert main.main(["cache", "--clear", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == told | {"kernels": 0, "bytes": 0, "deleted": 2}
    assert kept(base) == sorted(mine)
    assert main.main(["cache", "--clear"]) == 0
    assert capsys.readouterr().out == f"{base}: 0 kernels deleted\n"
    heals_too = [start(), start()]
    assert heals_too == [False, True]


def test_the_command_says_what_it_cannot_do(base, monkeypatch, capsys):
    start()
    with pytest.raises(SystemExit) as left:
        main.main(["cache", "--cler"])
    assert left.value.code == 2 and "--clear" in capsys.readouterr().err

    def fail(*_, **__):
        raise PermissionError(errno.EACCES, "no")

    with monkeypatch.context() as patched:
        patched.setattr(os, "unlink", fail)
        assert main.main(["cache", "--clear"]) == 1
    assert "1 files in" in capsys.readouterr().err
    assert start()


def test_the_command_does_not_wait_for_numba():
    code = "import sys; from engine.cli import main; main.main(['cache']); print({'numba', 'numpy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"
