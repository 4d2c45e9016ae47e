"""An archive of kernels is tried on a machine before it is used, in another process: where its code does not run, it
harms nothing, and the kernels are compiled."""

import json
import subprocess
import sys

import pytest
from conftest import ROOT

from engine.compiler import archive_trial, cache, shipped
from engine.compiler.targets import fitting_targets
from tests.compiler.test_shipped import skip_if_stale

PROGRAMS = {
    "it dies": ("import os; os.abort()", "its trial ended with "),
    "it fails": ("raise SystemExit('no such kernel')", "its trial ended with 1: no such kernel"),
    "it hangs": ("import time; time.sleep(60)", "no sound within 0.5 s"),
    "its samples are others": ("print('0' * 64)", "its samples are others"),
}


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache of this test, and nothing remembered before and after."""
    remembered = cache.kernel_folder, cache.warn_once, archive_trial.find_result, shipped.fitting_archive
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    for one in remembered:
        one.cache_clear()
    yield
    for one in remembered:
        one.cache_clear()


def best_archive():
    archives = [shipped.archive(target) for target in fitting_targets()]
    if not archives:
        pytest.skip("no archive is for this machine")
    return archives[0]


def is_passed(path):
    return shipped.result_of_trial(path) == archive_trial.PASSED


def use_program(monkeypatch, tmp_path, source):
    """Let a trial be another program."""
    (tmp_path / "trial_program.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(archive_trial, "SCENES", "trial_program")


@pytest.mark.parametrize("kind", PROGRAMS)
def test_an_archive_that_does_not_run_is_not_used_and_that_is_said_once(
    empty_cache, tmp_path, monkeypatch, capfd, kind
):
    source, why = PROGRAMS[kind]
    use_program(monkeypatch, tmp_path, source)
    monkeypatch.setattr(archive_trial, "SECONDS", 0.5 if kind == "it hangs" else 30.0)
    path = best_archive()
    assert not is_passed(path)
    assert shipped.result_of_trial(path).startswith(why)
    archive_trial.find_result.cache_clear()  # the next process
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("it was tried again"))
    assert not is_passed(path)
    said = capfd.readouterr().err.splitlines()
    assert len(said) == 1 and f"{path.name} does not run on this machine ({why}" in said[0]


def test_one_that_runs_is_tried_once(empty_cache, monkeypatch):
    skip_if_stale()
    path = best_archive()
    assert is_passed(path)
    archive_trial.find_result.cache_clear()
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("it was tried again"))
    assert is_passed(path)


def test_where_nothing_can_be_kept_each_process_tries(empty_cache, tmp_path, monkeypatch):
    skip_if_stale()
    monkeypatch.setattr(cache, "kernel_folder", lambda: (_ for _ in ()).throw(OSError("read-only")))
    path = best_archive()
    for _ in range(2):
        assert is_passed(path)
        archive_trial.find_result.cache_clear()


def test_two_first_starts_at_once_both_sound(empty_cache, tmp_path):
    skip_if_stale()
    words = [sys.executable, "-m", "engine", "render", "bouncing_ball", "--seconds", "0.05", "--kernel", "general"]
    started = [subprocess.Popen([*words, "-o", tmp_path / f"{n}.wav"], cwd=ROOT) for n in range(2)]
    assert [process.wait() for process in started] == [0, 0]
    assert (tmp_path / "0.wav").read_bytes() == (tmp_path / "1.wav").read_bytes()


def test_code_that_is_damaged_harms_nothing(empty_cache, tmp_path, capfd):
    """Each byte of its machine code is an instruction that stops a process."""
    skip_if_stale()
    path, damaged = best_archive(), tmp_path / best_archive().name
    lief, members = pytest.importorskip("lief"), {shipped.ABOUT: shipped.read_member(path, shipped.ABOUT)}
    for name in shipped.read_about(path)["parts"]:
        content = bytearray(shipped.read_member(path, name))
        read = lief.ELF.parse(bytes(content))  # its sections live with it
        text = next(section for section in read.sections if section.name == ".text")
        content[text.offset : text.offset + text.size] = b"\xcc" * text.size
        members[name] = bytes(content)
    shipped.write_members(damaged, members)
    assert not is_passed(damaged)
    assert "does not run on this machine (its trial ended with -" in capfd.readouterr().err


def test_a_program_that_is_one_file_does_not_start_itself_again(empty_cache, monkeypatch):
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("it was started"))
    assert is_passed(best_archive())


def test_a_trial_uses_no_kernel_that_was_compiled(empty_cache, tmp_path, monkeypatch, capfd):
    """An archive without kernels fails, though all could be compiled."""
    skip_if_stale()
    empty = tmp_path / best_archive().name
    about = shipped.read_about(best_archive()) | {"kernels": {}}
    shipped.write_members(empty, {shipped.ABOUT: json.dumps(about).encode()})
    assert not is_passed(empty)
    assert "the archive has no kernel" in capfd.readouterr().err
