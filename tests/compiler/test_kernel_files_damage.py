"""Compiled kernels on disk that are damaged: a render is right, and the next start has them again."""

import os
import pickle
import shutil
import subprocess
import sys

import pytest
import soundfile
from conftest import ROOT
from kernel_files import PATCH, Runs, heals, kept, only, sealed, start, twice

from engine.compiler import cache, cache_files
from engine.compiler.decorators import c_callback, kernel


def flipped(data: bytes, place: float) -> bytes:
    i = int(place * (len(data) - 1))
    return data[:i] + bytes([data[i] ^ 4]) + data[i + 1 :]


DAMAGE = {
    "empty": lambda data: b"",
    "truncated": lambda data: data[: len(data) // 2],
    "truncated within the digest": lambda data: data[:20],
    "digest alone": lambda data: data[:32],
    "digest of nothing": lambda data: sealed(b""),
    "garbage": lambda data: os.urandom(len(data)),
    "zeros": lambda data: bytes(len(data)),
    "longer": lambda data: data + b"\0",
    "a bit of the digest": lambda data: flipped(data, 0.0),
    "a bit of the key": lambda data: flipped(data, 0.01),
    "a bit of the code": lambda data: flipped(data, 0.5),
    "the last bit": lambda data: flipped(data, 1.0),
    "no pickle": lambda data: sealed(b"no pickle"),
    "another pickle": lambda data: sealed(pickle.dumps(1)),
    "another tuple": lambda data: sealed(pickle.dumps((1, 2))),
}


def test_a_second_start_loads(base):
    assert not start()
    assert start()
    assert not start(3)  # a whole number: a kernel of its own
    assert start(3) and start()
    assert len(kept(base)) == 2


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_file_heals(base, kind, capsys):
    start()
    path = only(base)
    path.write_bytes(DAMAGE[kind](path.read_bytes()))
    heals(base)
    assert capsys.readouterr().err == ""


def test_code_that_cannot_be_loaded_heals(base):
    """The file is whole, but its content is not what this compiler takes."""
    start()
    key, parts = pickle.loads(only(base).read_bytes()[32:])
    only(base).write_bytes(sealed(cache.dumps((key, (*parts, "more")))))
    heals(base)


def test_nothing_is_loaded_that_does_not_match(base, tmp_path):
    """What would run if it were loaded as a pickle does not run."""
    start()
    path, ran = only(base), tmp_path / "ran"
    content = pickle.dumps(Runs(ran))
    path.write_bytes(sealed(content)[:32] + b"\0" + content)
    heals(base)
    path.write_bytes(content)
    heals(base)
    assert not ran.exists()
    path.write_bytes(sealed(content))
    start()
    assert ran.exists(), "this test tests nothing"


def test_a_kernel_under_another_name_is_not_used(base):
    start()
    one = only(base)
    start(3)
    (other,) = set(kept(base)) - {one}
    shutil.copy(other, one)
    assert not start()
    assert start() and start(3)


def test_an_edited_function_is_compiled_again(base, tmp_path, monkeypatch):
    """Its source is not of this engine, so that the folder is the same."""
    monkeypatch.syspath_prepend(tmp_path)

    def value(factor: int) -> float:
        path = tmp_path / "edited.py"
        path.write_text(f"FACTOR = {factor}.0\ndef scaled(x):\n    return FACTOR * x\n")
        cache.file_digest.cache_clear()
        names: dict = {}
        exec(compile(path.read_text(), str(path), "exec"), names)
        return kernel(names["scaled"])(1.0)

    assert [value(2), value(3), value(3)] == [2.0, 3.0, 3.0]
    assert only(base)


def test_a_function_without_a_file_is_compiled(base):
    names: dict = {}
    exec("def half(x):\n    return x / 2\n", names)
    assert kernel(names["half"])(3.0) == 1.5
    assert not kept(base)


def test_a_callback_is_kept(base):
    declare = c_callback("float64(float64)")
    assert declare(twice).cache_hits == 0
    assert declare(twice).cache_hits == 1
    only(base).write_bytes(b"")
    assert declare(twice).cache_hits == 0
    assert declare(twice).ctypes(2.0) == 4.0


def test_recompiling_does_not_load(base):
    dispatcher = kernel(twice)
    dispatcher(1.0)
    dispatcher.recompile()
    assert not dispatcher.stats.cache_hits
    assert start()


@pytest.mark.hard
def test_damage_to_a_whole_render_heals(tmp_path):
    """All files of a cache are damaged in all ways: the samples are the same, and the files are there again."""

    def render(cache: str | None = None) -> tuple[bytes, list[str]]:
        words = [sys.executable, str(ROOT / "render.py"), PATCH, "--seconds", "0.01", "-o", str(tmp_path / "a.wav")]
        environment = os.environ | ({"NUMBA_CACHE_DIR": cache} if cache else {})
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        said = [line for line in done.stderr.splitlines() if "compiling the kernel" not in line]
        return soundfile.read(tmp_path / "a.wav")[0].tobytes(), said

    sound, _ = render()
    present = cache.kernel_folder()
    folder = tmp_path / "cache" / "fdh-engine" / present.name
    used = [path for path in kept(present) if path.name.startswith(("render_block.", "struct_handle."))]
    assert used
    folder.mkdir(parents=True)
    for i, path in enumerate(used):
        damage = list(DAMAGE.values())[i % len(DAMAGE)]
        (folder / path.name).write_bytes(damage(path.read_bytes()))
    assert render(str(tmp_path / "cache")) == (sound, [])
    healed = {path: path.stat().st_ino for path in kept(folder) if cache_files.read(path)}
    assert healed
    assert render(str(tmp_path / "cache")) == (sound, [])
    assert {path: path.stat().st_ino for path in healed} == healed, "it was compiled again"
