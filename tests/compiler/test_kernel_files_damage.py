"""Compiled kernels on disk that are damaged: a render is right, and the next start has them again."""

import json
import os
import shutil
import subprocess
import sys

import pytest
import soundfile
from conftest import ROOT
from kernel_files import PATCH, heals, kept, only, sealed, start

from engine.compiler import cache, cache_files


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
    "no key": lambda data: sealed(b"no key"),
    "nothing but a key": lambda data: sealed(data[32:].split(b"\n")[0]),
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


@pytest.mark.parametrize("kind", ["no header", "no object", "another symbol", "needs what is not there"])
def test_code_that_cannot_be_loaded_heals(base, kind):
    """The file is whole, but its content is not what is loaded."""
    start()
    key, header, code = only(base).read_bytes()[32:].split(b"\n", 2)
    about = json.loads(header)
    changed = {
        "no header": (b"[]", code),
        "no object": (header, b""),
        "another symbol": (json.dumps(about | {"functions": ["none"]}).encode(), code),
        "needs what is not there": (json.dumps(about | {"needed": ["no_such_function"]}).encode(), code),
    }
    only(base).write_bytes(sealed(b"\n".join([key, *changed[kind]])))
    heals(base)


def test_a_kernel_under_another_name_is_not_used(base):
    start()
    one = only(base)
    start(3)
    (other,) = set(kept(base)) - {one}
    shutil.copy(other, one)
    assert not start()
    assert start() and start(3)


@pytest.mark.hard
def test_damage_to_a_whole_render_heals(tmp_path):
    """All files of a cache are damaged in all ways: the samples are the same, and the files are there again."""

    def render(cache: str | None = None) -> tuple[bytes, list[str]]:
        words = [sys.executable, str(ROOT / "render.py"), PATCH, "--seconds", "0.01", "-o", str(tmp_path / "a.wav")]
        words += ["--kernel", "special"]
        environment = os.environ | ({"NUMBA_CACHE_DIR": cache} if cache else {})
        done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        said = [line for line in done.stderr.splitlines() if "compiling " not in line]
        return soundfile.read(tmp_path / "a.wav")[0].tobytes(), said

    sound, said = render()
    present = cache.kernel_folder()
    folder = tmp_path / "cache" / "fdh-engine" / present.name
    used = [path for path in kept(present) if path.name.startswith(("render_block.", "partitions."))]
    assert used
    folder.mkdir(parents=True)
    for i, path in enumerate(used):
        damage = list(DAMAGE.values())[i % len(DAMAGE)]
        (folder / path.name).write_bytes(damage(path.read_bytes()))
    assert render(str(tmp_path / "cache")) == (sound, said)
    healed = {path: path.stat().st_ino for path in kept(folder) if cache_files.read(path)}
    assert healed
    assert render(str(tmp_path / "cache")) == (sound, said)
    assert {path: path.stat().st_ino for path in healed} == healed, "it was compiled again"
