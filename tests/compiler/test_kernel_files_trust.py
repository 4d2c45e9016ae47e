"""Compiled kernels on disk: none is run that another user could have written."""

import errno
import multiprocessing
import os
import stat
import tempfile
from pathlib import Path

import pytest
from kernel_files import heals, kept, only, planted, start

from engine.cli import main


def test_folders_and_files_are_private(base):
    start()
    folder = only(base).parent
    assert [stat.S_IMODE(path.stat().st_mode) for path in (base, folder, only(base))] == [0o700, 0o700, 0o600]


def test_a_folder_of_this_user_is_closed_to_others(base):
    """An earlier version left it open to a group, with a umask of 002."""
    start()
    for path in (base, only(base).parent):
        path.chmod(0o775)
    assert start()
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o700 for path in (base, only(base).parent))


def test_a_user_without_a_cache_folder_has_a_temporary_one(temporary, capsys):
    assert not start()
    assert start()
    assert only(temporary) and stat.S_IMODE(temporary.stat().st_mode) == 0o700
    assert capsys.readouterr().err == ""


def made(path: Path, mode: int = 0o700) -> None:
    path.mkdir()
    path.chmod(mode)


def of_another(path: Path) -> None:
    """A folder that belongs to another user, or to this one who is then another."""
    path.mkdir()
    if os.geteuid() == 0:
        os.chown(path, 65534, 65534)


def a_link(path: Path) -> None:
    made(path.parent / "target")
    path.symlink_to(path.parent / "target")


UNTRUSTED = {
    "of another user": (of_another, "belongs to another user"),
    "open to all": (lambda path: made(path, 0o1777), "can be written to by other users"),
    "open to a group": (lambda path: made(path, 0o770), "can be written to by other users"),
    "a link": (a_link, "is not a folder"),
    "a file": (Path.touch, "is not a folder"),
}


@pytest.mark.parametrize("kind", UNTRUSTED)
def test_a_folder_that_others_may_have_made_is_not_used(temporary, monkeypatch, capsys, kind):
    """Kernels are compiled in memory, one line says so, and nothing of what is there is run."""
    make, why = UNTRUSTED[kind]
    make(temporary)
    if kind == "of another user" and os.geteuid() != 0:
        pytest.skip("only root can give a folder away")
    before = kept(temporary.parent)
    assert not start() and not start()
    assert kept(temporary.parent) == before
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and why in said and "cannot be kept" in said


@pytest.mark.parametrize("inner", [False, True])
def test_planted_kernels_are_not_run(temporary, capsys, inner):
    """In a folder that is open to others, or in one inside it."""
    start()
    path = only(temporary)
    path.write_bytes(planted())
    (path.parent if inner else temporary).chmod(0o777)
    assert not start()
    assert "can be written to by other users" in capsys.readouterr().err


def test_another_user_is_refused(temporary, monkeypatch, capsys):
    me = os.geteuid()
    made(temporary.parent / f"fdh-engine-{me + 1}")
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    assert not start() and not start()
    assert "belongs to another user" in capsys.readouterr().err


@pytest.mark.parametrize(("mode", "loads"), [(0o1777, True), (0o777, False), (0o775, False)])
def test_a_shared_folder_must_be_sticky(temporary, capsys, mode, loads):
    """Elsewhere another user could put a folder in the place of ours after it was looked at."""
    temporary.parent.chmod(mode)
    assert [start(), start()] == [False, loads]
    assert ("lets other users rename" in capsys.readouterr().err) is not loads


def test_a_user_without_any_folder(fresh, tmp_path, monkeypatch, capsys):
    """No home, and nowhere to put a temporary file."""

    def nowhere(*_):
        raise FileNotFoundError(errno.ENOENT, "no usable temporary directory")

    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "none"))
    monkeypatch.setattr(tempfile, "gettempdir", nowhere)
    assert not start() and not start()
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert main.main(["cache"]) == 1
    assert "no usable temporary directory" in capsys.readouterr().err


def test_a_planted_kernel_would_run_if_it_were_trusted(base):
    """Or the tests beside this one would test nothing."""
    start()
    only(base).write_bytes(planted())
    with pytest.raises(AssertionError):
        start()


def test_a_file_that_others_can_write_to_is_not_run(base):
    start()
    path = only(base)
    path.write_bytes(planted())
    path.chmod(0o666)
    heals(base)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_file_of_another_user_is_not_run(base):
    start()
    path = only(base)
    path.write_bytes(planted())
    os.chown(path, 65534, 65534)
    heals(base)


def test_links_are_not_followed(base, tmp_path):
    """Neither to read, nor to write, nor to delete."""
    start()
    path, other = only(base), tmp_path / "other.nbc"
    path.rename(other)
    content = other.read_bytes()
    path.symlink_to(other)
    heals(base)
    assert not path.is_symlink() and other.read_bytes() == content
    (tmp_path / "folder").mkdir()
    other.rename(tmp_path / "folder" / "other.nbc")
    (base / "0123456789abcdef").symlink_to(tmp_path / "folder")
    (path.parent / "inner").symlink_to(tmp_path / "folder")
    assert main.main(["cache", "--clear"]) == 0
    assert (tmp_path / "folder" / "other.nbc").read_bytes() == content


def test_workers_say_nothing(temporary, monkeypatch, capsys):
    temporary.touch()
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: "someone")
    assert not start()
    assert capsys.readouterr().err == ""
