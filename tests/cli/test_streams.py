"""The program in surroundings that are not made for it: encodings, closed or full streams, folders that are gone.

None may give a traceback, hang, or lose what was to be written. Most of the commands are quick; those that render are
tried in each surrounding once, among the hard tests.
"""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile
from conftest import ALSA, ROOT, mostly_hard, needs_alsa, needs_portaudio

PIANO, BALL = (str(ROOT / "patches" / f"{name}.toml") for name in ("piano_c4", "bouncing_ball"))
QUICK = [
    "--help", "", "check --help", "params --help", "new --help", "schema --help", "reference --help", "cache --help",
    "recover --help", f"check {PIANO}", f"check {PIANO} bad.toml", "check none.toml", f"params {PIANO}",
    f"params {PIANO} --json", "params bad.toml", "params titled.toml", "check titled.toml", "reference", "schema",
    "cache", "cache --json", "recover .", "recover none", "new mine", "new mine --like bar", "new ''", "new x/y",
    "chekc", "--sceonds", "none.toml", "bad.toml", "latin.toml", f"{BALL} --seconds -1 --gain loud",
    f"{BALL} -o no/a.wav", f"{BALL} -o a.mp7", f"{BALL} --record r.wav", f"play {BALL} --block-size many",
    f"play {BALL} --record no/r.wav", f"sweep {BALL} --vary x=1 -o v", "replay none.json", "replay bad.toml",
    f"{BALL} --live", "play --help", "--version",
]  # fmt: skip
SLOW = [
    "devices", f"play {BALL} --device theremin", f"{BALL} --seconds 0.1 -o a.wav",
    f"{BALL} --seconds 0.1 -o a.wav --json", f"inspect {BALL} --seconds 0.1",
    f"inspect {BALL} --json --seconds 0.1", f"{PIANO} --seconds 0.1 -o a.wav --gain 200 --subtype PCM_16",
    f"play {BALL} --seconds 0.3 --ignore-speed --record r.wav --event-log l.json", "replay l.json -o again.wav",
    f"sweep {BALL} --vary body.ball.mass=1,2 --seconds 0.1 -o v", "titled.toml --seconds 0.1 -o t.wav",
    "inspect titled.toml --seconds 0.1", f"{BALL} --seconds 0.1 -o p.wav --report --plot",
    f"{PIANO} --midi none.mid", f"accuracy {BALL} --seconds 0.05",
]  # fmt: skip
C_LOCALE = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
SURROUNDINGS = {  # what the environment has, what the shell does with the streams
    "cp1252": ({"PYTHONIOENCODING": "cp1252"}, ""),
    "ascii": ({"PYTHONIOENCODING": "ascii"}, ""),
    "C": (C_LOCALE, ""),
    "no input": ({}, "<&-"),
    "no output": ({}, ">&-"),
    "no errors": ({}, "2>&-"),
    "nothing": ({}, "<&- >&- 2>&-"),
    "full": ({}, ">/dev/full"),
    "all full": ({}, ">/dev/full 2>/dev/full"),
    "left": ({}, "| head -c 1 >/dev/null"),
    "gone": ({}, "gone"),
    "no home": ({"HOME": None, "XDG_CACHE_HOME": None, "TMPDIR": "/nonexistent"}, ""),
}
DEFAULT = {
    "cp1252": slice(0, None, 4),
    "C": slice(1, None, 8),
    "no output": slice(2, None, 8),
    "gone": slice(3, None, 8),
}
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a shell, and /dev/full")


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder with patches: one with faults, one that is no text, one whose names are in no small encoding."""
    lines = Path(BALL).read_text("utf-8").splitlines()
    (tmp_path / "bad.toml").write_text('seconds = -1\n[[body]]\nname = "ä→"\nkind = "mäss"\n', "utf-8")
    (tmp_path / "latin.toml").write_bytes(b'title = "\xe9"\n')
    titled = ['title = "Bäll → 球 🎱"', *(line for line in lines if not line.startswith(("title", "#:schema")))]
    (tmp_path / "titled.toml").write_text("\n".join(titled), "utf-8")
    return tmp_path


def environment(changes: dict[str, str | None]) -> dict[str, str]:
    """That of this process, with changes; None takes away."""
    whole = os.environ | changes
    return {name: value for name, value in whole.items() if value is not None}


def shell(line: str, cwd: Path, **told) -> subprocess.CompletedProcess:
    """render.py by a shell."""
    command = f"{shlex.join([sys.executable, str(ROOT / 'render.py')])} {line}"
    told = {"capture_output": True, "timeout": 240.0, "stdin": subprocess.DEVNULL, "cwd": cwd} | told
    return subprocess.run(["bash", "-c", f"set -o pipefail; {command}"], **told)


def tried(words: str, where: str, folder: Path, changes: dict[str, str] | None = None) -> subprocess.CompletedProcess:
    """A command in a surrounding; it ends with an exit code of its own, and says nothing of Python's."""
    own, streams = SURROUNDINGS[where]
    cwd = folder
    if streams == "gone":
        cwd = folder / "gone"
        cwd.mkdir()
        words, streams = words.replace(" -o ", f" -o {folder}/"), ""
        done = _from_nowhere(words, cwd, own | (changes or {}))
    else:
        done = shell(f"{words} {streams}", cwd, env=environment(own | (changes or {})))
    said = done.stderr.decode(errors="replace")
    assert "Traceback" not in said and "Exception ignored" not in said, (words, said)
    assert done.returncode in (0, 1, 2), (words, done.returncode, said)
    if done.returncode == 2 and "2>" not in streams:
        assert said, words
    return done


def _from_nowhere(words: str, cwd: Path, changes: dict[str, str | None]) -> subprocess.CompletedProcess:
    """From a folder that is removed before the program begins."""
    command = f"rmdir {shlex.quote(str(cwd))}; exec {shlex.join([sys.executable, str(ROOT / 'render.py')])} {words}"
    told = {"capture_output": True, "timeout": 240.0, "stdin": subprocess.DEVNULL, "cwd": cwd}
    return subprocess.run(["bash", "-c", command], env=environment(changes), **told)


@pytest.mark.hard
@pytest.mark.parametrize("where", DEFAULT)
def test_some_commands(folder, where):
    for words in QUICK[DEFAULT[where]]:
        tried(words, where, folder)


@pytest.mark.slow
@pytest.mark.parametrize("where", SURROUNDINGS)
def test_quick_commands(folder, where):
    for words in QUICK:
        (folder / "mine.toml").unlink(missing_ok=True)
        tried(words, where, folder)


@pytest.mark.slow
@pytest.mark.parametrize("where", SURROUNDINGS)
def test_slow_commands(folder, where):
    """What is to be written is written, wherever the messages go."""
    changes = dict[str, str]()
    if ALSA.exists():
        (folder / "asound.conf").write_text(f"<{ALSA}>\npcm.!default {{ type null }}\n")
        changes = {"ALSA_CONFIG_PATH": str(folder / "asound.conf"), "JACK_NO_START_SERVER": "1"}
    for words in SLOW:
        if words.startswith("sweep"):  # into a folder that is not there
            shutil.rmtree(folder / "v", ignore_errors=True)
        tried(words, where, folder, changes)
    varied = () if where == "gone" else ("v/index.csv",)  # processes that share the work need a folder to be in
    for name in ("a.wav", "p.wav", "p.html", *varied):
        assert (folder / name).stat().st_size > 100, name


@pytest.mark.hard
@pytest.mark.parametrize("encoding", ["ascii", *(pytest.param(e, marks=pytest.mark.hard) for e in ("cp1252", "utf-8"))])
def test_signs_that_cannot_be_shown(folder, encoding):
    """They are written as \\u and a number, in JSON too, which stays JSON."""
    env = environment({"PYTHONIOENCODING": encoding})
    told = shell("params titled.toml --json", folder, env=env).stdout
    assert json.loads(told.decode("ascii"))["patch"] == "titled.toml"
    schema = shell("schema", folder, env=env).stdout
    wanted = (ROOT / "patches" / "patch.schema.json").read_text("utf-8")
    assert json.loads(schema.decode(encoding)) == json.loads(wanted)
    reference = shell("reference", folder, env=env).stdout.decode(encoding)
    assert ("\\u03b1" in reference) == (encoding != "utf-8")
    assert reference.count("\n") == (ROOT / "docs" / "patches.md").read_text("utf-8").count("\n")


@pytest.mark.hard
@pytest.mark.parametrize(
    ("streams", "says"),
    [
        (">/dev/full", "render.py: cannot write to standard output (no space left on device)\n"),
        (">&-", "render.py: cannot write to standard output (bad file descriptor)\n"),
        (">/dev/full 2>/dev/full", ""),
        ("| head -1 >/dev/null", ""),
    ],
)
@pytest.mark.parametrize("words", ["reference", pytest.param("--help", marks=pytest.mark.hard)])
def test_an_output_that_takes_nothing(folder, words, streams, says):
    """One line and exit code 1; none where the reader left, and may have had enough."""
    done = shell(f"{words} {streams}", folder)
    left = streams.startswith("|")
    assert done.returncode == 1 or (left and done.returncode == 0)
    assert done.stderr.decode() == says


NAMES = [b"b\xe4ll", "bäll→".encode()]


@pytest.mark.system
@pytest.mark.parametrize("name", mostly_hard(NAMES, NAMES[0]))
def test_names_that_are_no_text(folder, name):
    """A patch and a sound whose names are bytes of another encoding; they are told as they are."""
    patch, out, flac = (os.path.join(os.fsencode(folder), name + end) for end in (b".toml", b".wav", b".flac"))
    shutil.copy(BALL, patch)
    command = [sys.executable, str(ROOT / "render.py")]
    told = {"capture_output": True, "timeout": 60.0, "cwd": folder}
    for words in (["check", patch], ["params", patch, "--json"]):
        done = subprocess.run([*command, *words], **told)
        assert done.returncode == 0 and done.stderr == b"", done.stderr
    for sound in (flac, out):
        done = subprocess.run([*command, patch, "-o", sound, "--seconds", "0.1"], **told)
        assert done.returncode == 0 and done.stdout.endswith(os.path.basename(sound) + b"\n")
        assert soundfile.info(os.fsdecode(sound) if name == NAMES[1] else sound).frames == 4410
    missing = subprocess.run([*command, "check", b"none" + name + b".toml"], **told)
    assert missing.returncode == 2 and b"Traceback" not in missing.stderr


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, C_LOCALE, {"PYTHONIOENCODING": "ascii"}], ids=["utf8", "C", "ascii"])
@pytest.mark.parametrize("name", NAMES, ids=["latin", "utf8"])
def test_more_names_that_are_no_text(folder, name, changes):
    """Everything that writes a file writes it under that name."""
    patch, base = os.path.join(os.fsencode(folder), name + b".toml"), os.path.join(os.fsencode(folder), name)
    shutil.copy(BALL, patch)
    command = [sys.executable, str(ROOT / "render.py")]
    words = ["-o", base + b".wav", "--report", base + b".html", "--plot", base + b".png", "--trace", base + b".npz"]
    told = {"capture_output": True, "timeout": 120.0, "cwd": folder, "env": environment(changes)}
    sweep = ["sweep", "--vary", "body.ball.mass=1,2", "-o", base + b"_v"]
    for what, *more in (["render", *words], ["render", *words, "--json"], sweep, ["inspect"]):
        done = subprocess.run([*command, what, patch, "--seconds", "0.1", *more], **told)
        assert done.returncode == 0 and b"Traceback" not in done.stderr, done.stderr
    for end in (b".wav", b".html", b".png", b".npz", b"_v/index.csv"):
        assert os.path.getsize(base + end) > 100


@pytest.mark.hard
@needs_portaudio
@needs_alsa
@pytest.mark.parametrize(
    ("where", "code"),
    [
        ("<&- >&- 2>&-", 1),
        pytest.param("<&-", 0, marks=pytest.mark.hard),
        pytest.param("| head -c 1", 1, marks=pytest.mark.hard),
        pytest.param(">/dev/full", 1, marks=pytest.mark.hard),
    ],
)
def test_live_sound_without_streams(folder, where, code):
    """It plays to its end, and recording and log are kept: here with names that are no text."""
    (folder / "asound.conf").write_text(f"<{ALSA}>\npcm.!default {{ type null }}\n")
    env = environment({"ALSA_CONFIG_PATH": str(folder / "asound.conf"), "JACK_NO_START_SERVER": "1"})
    record, log = os.fsencode(folder) + b"/r\xe4.wav", os.fsencode(folder) + b"/l\xe4.json"
    line = f"play {PIANO} --seconds 0.3 --record $'{folder}/r\\xe4.wav' --event-log $'{folder}/l\\xe4.json' {where}"
    done = shell(line, folder, env=env)
    assert done.returncode == code and b"Traceback" not in done.stderr, done.stderr
    assert soundfile.info(record).frames == 13_230 and os.path.getsize(log) > 100


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid(), reason="needs root, to be somebody else")
def test_a_user_without_a_home(folder):
    """Nobody's: kernels are kept in the temporary folder, or not at all."""
    os.chmod(folder, 0o777)
    for up in folder.parents:
        if not os.stat(up).st_mode & 0o005:
            pytest.skip(f"{up} is closed to others")
    if not os.access(sys.executable, os.X_OK):
        pytest.skip("Python is not for others")
    env = environment({"HOME": None, "XDG_CACHE_HOME": None, "TMPDIR": str(folder)})
    done = subprocess.run(
        [sys.executable, str(ROOT / "render.py"), "cache"], env=env, capture_output=True, user=54321, cwd=folder
    )
    assert done.returncode in (0, 1) and b"Traceback" not in done.stderr, done.stderr
