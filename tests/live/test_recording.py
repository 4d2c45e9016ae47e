"""A live recording survives a full disk, a folder that goes, signals and kill -9; and what is left behind is found."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import soundfile
from conftest import ROOT, needs_alsa, needs_portaudio

from engine.cli import main
from engine.live import recovery
from engine.live.audio_recording import Recording, repair_header

PIANO = str(ROOT / "patches" / "piano_c4.toml")
NOISE = np.random.default_rng(1).uniform(-0.5, 0.5, (4410, 2)).astype(np.float32)
KINDS = ["wav", "flac", "ogg", "aiff", "caf", "w64", "au", "rf64", "mp3"]
KINDS = [kind for kind in KINDS if kind.upper() in soundfile.available_formats()]
OLD = time.time() - 8 * 86_400


def recorded(path, blocks: int = 40) -> Recording:
    """A recording at work."""
    made = Recording(path, 44_100, 2, None)
    for _ in range(blocks):
        made.write(NOISE)
    return made


def limited(made: Recording, most: int) -> None:
    """Let a disk be full at so many bytes."""
    file = made.tape.file

    class Full:
        def write(self, data):
            room = most - file.tell()
            if room <= 0:
                raise OSError(28, "No space left on device")
            return file.write(data[:room])

        def __getattr__(self, name):
            return getattr(file, name)

    made.tape.file = Full()


def test_a_recording_is_what_was_written(tmp_path):
    made = recorded(tmp_path / "a.wav")
    made.close()
    heard = soundfile.read(tmp_path / "a.wav", dtype="float32")[0]
    np.testing.assert_array_equal(heard, np.concatenate([NOISE] * 40))
    assert made.is_complete and not made.lines and [p.name for p in tmp_path.iterdir()] == ["a.wav"]


@pytest.mark.hard_for("mp3")
@pytest.mark.parametrize("kind", KINDS)
def test_a_full_disk_keeps_what_was_written(tmp_path, capsys, kind):
    """Under its name, as a file that can be played; one line says so, at once and once."""
    path = tmp_path / f"a.{kind}"
    made = recorded(path, 0)
    limited(made, 100_001)
    for _ in range(120):
        made.write(NOISE)
    assert not made.is_complete
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "recording ended after" in said and "(no space left on device)" in said
    made.close()
    assert capsys.readouterr().err == "" and [p.name for p in tmp_path.iterdir()] == [path.name]
    heard = soundfile.read(path, dtype="float32")[0]
    assert len(heard) > 9000
    if kind not in ("ogg", "mp3"):  # 16 bits at least
        wanted = np.concatenate([NOISE] * 120)[: len(heard)]
        assert np.abs(heard - wanted).max() <= 2**-15


@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_that_was_broken_off_can_be_kept(tmp_path, capsys, monkeypatch, kind):
    """What kill -9 leaves behind: found, named, and kept as a file that can be played; what others use is left alone.
    Of FLAC, OGG and MP3 the last tenth of a second is lost: libsndfile had not written it."""
    made = recorded(tmp_path / f"other.{kind}")
    shutil.copy(made.temporary, tmp_path / f".take.{kind}.123456.part")
    (tmp_path / f"take.{kind}").write_bytes(b"precious")
    monkeypatch.setattr(recovery, "IDLE_SECONDS", -1.0)
    assert (
        f"there are interrupted recordings: .take.{kind}.123456.part; recover them with"
        in recovery.describe_leftovers(tmp_path)
    )
    assert main.main(["recover", str(tmp_path)]) == 0
    kept = tmp_path / f"take_2.{kind}"
    assert str(kept) in capsys.readouterr().out
    assert (tmp_path / f"take.{kind}").read_bytes() == b"precious"
    heard = soundfile.read(kept, dtype="float32")[0]
    assert len(heard) >= 40 * 4410 - (0 if kind.upper() not in ("FLAC", "OGG", "MP3") else 8820)
    assert recovery.describe_leftovers(tmp_path) == ""
    made.close()
    assert soundfile.info(tmp_path / f"other.{kind}").frames >= 40 * 4410 - 4410


@pytest.mark.skipif(sys.platform == "win32", reason="an open file cannot be removed there")
def test_a_folder_that_was_removed_is_made_again(tmp_path):
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    made = recorded(folder / "take.wav")
    shutil.rmtree(tmp_path / "a")
    made.write(NOISE)
    made.close()
    assert soundfile.info(folder / "take.wav").frames == 41 * 4410
    assert made.is_complete and f"{folder} was removed during the recording; the recording is kept as" in made.lines[0]


@pytest.mark.skipif(sys.platform == "win32", reason="an open file cannot be removed there")
def test_a_folder_that_cannot_be_made_again(tmp_path, monkeypatch):
    """The recording goes to the temporary folder, beside what is there."""
    folder, spare = tmp_path / "a", tmp_path / "spare"
    folder.mkdir()
    spare.mkdir()
    (spare / "take.wav").write_bytes(b"precious")
    made = recorded(folder / "take.wav")
    shutil.rmtree(folder)
    folder.write_text("in the way")
    monkeypatch.setattr("tempfile.tempdir", str(spare))
    made.close()
    assert soundfile.info(spare / "take_2.wav").frames == 40 * 4410 and not made.is_complete
    assert (spare / "take.wav").read_bytes() == b"precious" and str(spare / "take_2.wav") in made.lines[0]


def test_a_name_that_cannot_be_taken(tmp_path):
    made = recorded(tmp_path / "take.wav")
    (tmp_path / "take.wav").mkdir()
    made.close()
    assert not made.is_complete and str(made.temporary) in made.lines[0]
    assert soundfile.info(str(made.temporary)).frames == 40 * 4410


def test_what_was_left_for_a_week_is_deleted(tmp_path, capsys):
    """Unless it holds sound: that is kept by recover."""
    recorded(tmp_path / "a.wav").close()
    os.rename(tmp_path / "a.wav", tmp_path / ".a.wav.99.part")
    for name in (".page.html.98.part", ".young.png.97.part", ".hidden"):
        (tmp_path / name).write_text("half")
    for name in (".a.wav.99.part", ".page.html.98.part", ".hidden"):
        os.utime(tmp_path / name, (OLD, OLD))
    assert ".a.wav.99.part" in recovery.describe_leftovers(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == [".a.wav.99.part", ".hidden", ".young.png.97.part"]
    assert main.main(["recover", str(tmp_path)]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == [".hidden", ".young.png.97.part", "a.wav"]
    capsys.readouterr()
    assert main.main(["recover", str(tmp_path)]) == 0
    assert "there is no interrupted recording" in capsys.readouterr().out
    assert main.main(["recover", str(tmp_path / "none")]) == 2
    assert "fdh FOLDER: no such folder" in capsys.readouterr().err


def test_what_is_no_sound_has_no_frames(tmp_path):
    (tmp_path / "a").write_bytes(b"fLaC" + bytes(100))
    assert repair_header(tmp_path / "a") == 0 and (tmp_path / "a").read_bytes() == b"fLaC" + bytes(100)


# --- the program


def program(device, *words: str, **told) -> subprocess.Popen:
    """render.py at work: it has said on what it plays."""
    command = [sys.executable, str(ROOT / "render.py"), "play", PIANO, *words]
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL, "text": True} | told
    hear = lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL)  # where the tests are run by nohup, too
    made = subprocess.Popen(command, env={**os.environ, **device}, **{"preexec_fn": hear, **told})
    if told["stdout"] == subprocess.PIPE:
        assert "on default" in made.stdout.readline()
    return made


@pytest.fixture
def device(file_device):
    """An environment whose default device takes what it is given, as fast as it comes, and keeps nothing."""
    environment, raw = file_device
    config = raw.parent / "asound.conf"
    config.write_text(config.read_text().splitlines()[0] + "\npcm.!default { type null }\n")
    return environment


def ended(made: subprocess.Popen) -> tuple[int, str, str]:
    out, said = made.communicate(timeout=30.0)
    assert "Traceback" not in said, said
    return made.returncode, out, said


def small_files() -> None:
    """No file may be larger: as a full disk, without one."""
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_live_sound_with_a_full_disk(tmp_path, device):
    record, log = tmp_path / "r.wav", tmp_path / "log.json"
    words = ["--seconds", "40", "--record", str(record), "--event-log", str(log)]
    code, _, said = ended(program(device, *words, preexec_fn=small_files))
    assert code == 1 and said.count("\n") == 1 and "recording ended after" in said and "playing continues" in said
    assert soundfile.info(record).frames > 300_000
    assert json.loads(log.read_text())["frames"] >= 40 * 44_100


@needs_portaudio
@needs_alsa
@pytest.mark.hard
def test_live_sound_with_a_disk_that_is_really_full(tmp_path, device):
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=300k", "none", str(small)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("nothing can be mounted here")
    try:
        words = ["--seconds", "9", "--record", str(small / "r.wav"), "--event-log", str(tmp_path / "log.json")]
        code, _, said = ended(program(device, *words))
        assert code == 1 and said.count("\n") == 1 and "(no space left on device)" in said
        assert soundfile.info(small / "r.wav").frames > 30_000
        assert [p.name for p in small.iterdir()] == ["r.wav"] and (tmp_path / "log.json").exists()
    finally:
        subprocess.run(["umount", str(small)], check=True)


@pytest.mark.system
@needs_portaudio
@needs_alsa
@pytest.mark.parametrize("name", ["SIGTERM", pytest.param("SIGHUP", marks=pytest.mark.hard)])
def test_a_signal_fades_out_and_keeps_all(tmp_path, device, name):
    record, log = tmp_path / "r.flac", tmp_path / "log.json"
    made = program(device, "--seconds", "3000", "--record", str(record), "--event-log", str(log))
    time.sleep(0.4)
    number = getattr(signal, name)
    made.send_signal(number)
    code, out, said = ended(made)
    assert code == 128 + number and said == f"render.py: ended by {name}\n"
    heard = soundfile.read(record)[0]
    assert len(heard) > 1000 and np.abs(heard[-1]).max() < 1e-3 and str(record) in out
    assert json.loads(log.read_text())["frames"] > 1000


@pytest.mark.hard
@needs_portaudio
@needs_alsa
def test_a_terminal_that_is_closed(tmp_path, device):
    """Keys, meter and messages have nowhere to go any more; the recording and the log are kept."""
    import pty

    record, log, (keys, terminal) = tmp_path / "r.wav", tmp_path / "log.json", pty.openpty()
    told = dict.fromkeys(("stdin", "stdout", "stderr"), terminal)
    words = ["--seconds", "3000", "--record", str(record), "--event-log", str(log)]
    made = program(device | {"TERM": "xterm"}, *words, **told, start_new_session=True)
    os.close(terminal)
    shown = b""
    while b"load" not in shown:
        shown += os.read(keys, 4096)
    os.close(keys)
    time.sleep(0.3)
    made.send_signal(signal.SIGHUP)
    assert made.wait(30.0) in (1, 128 + signal.SIGHUP)
    assert soundfile.info(record).frames > 1000 and log.exists()
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".conf", ".json", ".wav"]


@pytest.mark.hard
@needs_portaudio
@needs_alsa
@pytest.mark.parametrize("kind", ["wav", pytest.param("flac", marks=pytest.mark.hard)])
def test_kill_leaves_what_the_next_one_finds(tmp_path, device, kind):
    folder = tmp_path / "takes"
    folder.mkdir()
    made = program(device, "--seconds", "3000", "--record", str(folder / f"r.{kind}"))
    deadline = time.monotonic() + 20.0
    while sum(p.stat().st_size for p in folder.iterdir()) < 10_000 and time.monotonic() < deadline:
        time.sleep(0.1)
    made.kill()
    made.communicate()
    part = f".r.{kind}.{made.pid}.part"
    assert [p.name for p in folder.iterdir()] == [part]
    time.sleep(recovery.IDLE_SECONDS)
    again = program(device, "--seconds", "1", "--record", str(folder / "s.wav"))
    code, _, said = ended(again)
    assert code == 0 and said == (
        f"render.py: there are interrupted recordings: {part}; recover them with render.py recover {folder}\n"
    )
    assert main.main(["recover", str(folder)]) == 0
    assert len(soundfile.read(folder / f"r.{kind}")[0]) > 4410
    assert sorted(p.name for p in folder.iterdir()) == [f"r.{kind}", "s.wav"]


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_folders_that_go_while_it_plays(tmp_path, device):
    folder = tmp_path / "takes"
    folder.mkdir()
    made = program(device, "--seconds", "3000", "--record", "r.wav", "--event-log", "log.json", cwd=folder)
    time.sleep(0.3)
    shutil.rmtree(folder)
    made.send_signal(signal.SIGINT)
    code, _, said = ended(made)
    assert code == 130 and "takes was removed during the recording; the recording is kept as" in said
    assert (folder / "log.json").exists()
    assert soundfile.info(folder / "r.wav").frames > 1000
