"""Compiled kernels on disk: whatever is wrong with them, a render is right, and the next start has them again."""

import errno
import hashlib
import json
import multiprocessing
import os
import pickle
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
import soundfile
from conftest import ROOT

from engine.cli import main
from engine.compiler import cache, cache_files
from engine.compiler.decorators import c_callback, kernel

resource = pytest.importorskip("resource", reason="Windows has no owners of this kind")
PATCH = str(ROOT / "patches" / "repelled_oscillator.toml")


@pytest.fixture
def fresh(monkeypatch):
    """Forgets what this process knows of folders, before and after."""
    caches = (cache.folder, cache.digest, cache._say)
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
    cache.folder.cache_clear()
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


# --- damage


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
        cache._stamp.cache_clear()
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
    present = cache.folder()
    folder = tmp_path / "cache" / "fdh-engine" / present.name
    used = [path for path in kept(present) if path.name.startswith(("block.", "held."))]
    folder.mkdir(parents=True)
    for i, path in enumerate(used):
        damage = list(DAMAGE.values())[i % len(DAMAGE)]
        (folder / path.name).write_bytes(damage(path.read_bytes()))
    assert render(str(tmp_path / "cache")) == (sound, [])
    healed = {path: path.stat().st_ino for path in kept(folder) if cache_files.read(path)}
    assert healed
    assert render(str(tmp_path / "cache")) == (sound, [])
    assert {path: path.stat().st_ino for path in healed} == healed, "it was compiled again"


# --- trust


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
def test_planted_kernels_are_not_run(temporary, tmp_path, capsys, inner):
    """In a folder that is open to others, or in one inside it."""
    start()
    ran = tmp_path / "ran"
    path = only(temporary)
    path.write_bytes(sealed(pickle.dumps(Runs(ran))))
    (path.parent if inner else temporary).chmod(0o777)
    assert not start()
    assert not ran.exists() and "can be written to by other users" in capsys.readouterr().err


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


def test_a_file_that_others_can_write_to_is_not_run(base, tmp_path):
    start()
    path, ran = only(base), tmp_path / "ran"
    path.write_bytes(sealed(pickle.dumps(Runs(ran))))
    path.chmod(0o666)
    heals(base)
    assert not ran.exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_file_of_another_user_is_not_run(base, tmp_path):
    start()
    path, ran = only(base), tmp_path / "ran"
    path.write_bytes(sealed(pickle.dumps(Runs(ran))))
    os.chown(path, 65534, 65534)
    heals(base)
    assert not ran.exists()


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


# --- several processes, and disks that are full or cannot be written to

SMALL = """
import sys
from typing import NamedTuple
from engine.compiler.decorators import kernel

class Pair(NamedTuple):
    x: float
    y: float

@kernel
def total(pair):
    return pair.x + pair.y

for pair in [Pair(1.5, 2.5), Pair(1, 3), Pair(1, 3.0)][:: int(sys.argv[1])]:
    assert total(pair) == 4
print(sum(total.stats.cache_hits.values()))
"""


@pytest.mark.hard
def test_processes_that_compile_the_same_at_once(tmp_path):
    (tmp_path / "small.py").write_text(SMALL)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def process(way: int) -> subprocess.Popen:
        words = [sys.executable, "-c", "import small", str(way)]
        return subprocess.Popen(
            words, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    for _, stderr in [p.communicate() for p in [process(way) for way in (1, -1, 1, -1)]]:
        assert stderr == ""
    files = kept(tmp_path / "cache")
    assert len(files) == 3 and all(path.suffix == ".nbc" for path in files)
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


# --- size


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
    same = [store(base / (cache.folder().name[:17] + f"{i:08x}"), "a.nbc", 1e6) for i in range(6)]
    assert start()
    assert all(path.exists() for path in same)
    assert [folder.exists() for folder in others] == [True, True, True, False, True, False]
    assert kept(others[4]) == [others[4] / "mine.txt"]
    assert kept(base / "notes")


def test_a_process_whose_folder_is_deleted_goes_on(base, monkeypatch):
    dispatcher = kernel(twice)
    assert dispatcher(1.5) == 3.0
    shutil.rmtree(base / cache.folder().name)
    assert dispatcher(3) == 6 and dispatcher(1.5) == 3.0
    assert only(base)
    replace, gone = os.replace, []

    def late(part, path):
        if not gone:
            gone.append(path)
            shutil.rmtree(Path(path).parent)
        replace(part, path)

    monkeypatch.setattr(os, "replace", late)
    assert dispatcher(1 + 2j) == 2 + 4j
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


# --- the digest


def test_the_digest_is_of_all_kernel_sources(fresh, tmp_path, monkeypatch):
    shutil.copytree(ROOT / "engine", tmp_path / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(cache, "__file__", str(tmp_path / "engine" / "compiler" / "cache.py"))

    def digest() -> str:
        cache.digest.cache_clear()
        return cache.digest()

    deep, deeper = tmp_path / "engine" / "bodies_of" / "deep.py", tmp_path / "engine" / "others" / "deep.py"
    found = [digest()]
    deep.parent.mkdir()
    deep.write_text("from engine.compiler.decorators import inline\n")
    found.append(digest())
    deep.write_text("from engine.compiler.decorators import inline\nX = 1\n")
    found.append(digest())
    deeper.parent.mkdir()
    deep.rename(deeper)
    found.append(digest())
    assert len(set(found)) == 4
    deep.write_text("import json\n")
    assert digest() == found[-1]


@pytest.mark.parametrize("module", ["numba", "llvmlite", "np"])
def test_the_digest_is_of_the_compiler(fresh, monkeypatch, module):
    before = cache.digest()
    cache.digest.cache_clear()
    monkeypatch.setattr(getattr(cache, module), "__version__", "0")
    assert cache.digest()[:16] != before[:16]


@pytest.mark.parametrize("what", ["name", "features"])
def test_the_digest_is_of_the_processor(fresh, monkeypatch, what):
    before = cache.digest()
    cache.digest.cache_clear()
    if what == "name":
        monkeypatch.setattr(cache.llvmlite.binding, "get_host_cpu_name", lambda: "i486")
    else:
        monkeypatch.setattr(cache, "get_host_cpu_features", lambda: "+fpu")
    after = cache.digest()
    assert after[:17] == before[:17] and after[17:] != before[17:]
