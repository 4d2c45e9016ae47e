"""What stands where a file is to go, sounds of any length, and that equal renders are equal files."""

import os
import shutil
import stat
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import soundfile
from conftest import ROOT

from engine.cli import main
from engine.live.audio_recording import Recording, RecordingFile
from engine.output_files import save_audio, save_trace, write_text

BALL = str(ROOT / "patches" / "bouncing_ball.toml")
NOISE = 0.1 * np.random.default_rng(1).normal(size=(20_000, 1))
unix = pytest.mark.skipif(sys.platform == "win32", reason="links, modes and pipes of Unix")


def render(path, *words: str) -> int:
    return main.main(["render", BALL, "--seconds", "0.1", "-o", str(path), *words])


# --- in pieces


@pytest.mark.hard
@pytest.mark.parametrize("kind", ["ogg", "flac", "mp3", "wav", "aiff"])
def test_a_long_sound_is_written_from_a_thread_with_a_small_stack(tmp_path, kind):
    """libvorbis takes 4 bytes of stack for each frame of one write: 50 s ended the process."""
    path, frames = tmp_path / f"a.{kind}", 60 * 44_100
    code = (
        "import pathlib, threading, numpy as np; from engine.output_files import save_audio;"
        "threading.stack_size(1 << 19);"
        f"sound = 0.1 * np.sin(np.arange({frames}) / 20)[:, None];"
        f"thread = threading.Thread(target=save_audio, args=(pathlib.Path({str(path)!r}), sound, 44_100, None));"
        "thread.start(); thread.join()"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0
    assert abs(soundfile.info(path).frames - frames) <= 3000  # MP3 pads
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.hard
def test_a_recording_takes_one_block_of_a_minute(tmp_path):
    made = Recording(tmp_path / "a.ogg", 44_100, 1, None)
    made.write(0.1 * np.sin(np.arange(60 * 44_100) / 20)[:, None])
    made.close()
    assert made.is_complete and soundfile.info(tmp_path / "a.ogg").frames == 60 * 44_100


# --- beyond 4 GiB


@pytest.fixture
def sparse(monkeypatch):
    """Zeros take no room on the disk: a file of them has the same bytes with a hole."""

    def write(self, data) -> int:
        data = bytes(data)
        if data.count(0) != len(data):
            return self.file.write(data)
        end = self.file.seek(len(data), 1)
        if end > os.fstat(self.file.fileno()).st_size:
            self.file.truncate(end)
        self.size = max(self.size, end)
        return len(data)

    monkeypatch.setattr(RecordingFile, "write", write)


MARK = np.full((100, 16), 0.25, np.float32)
SILENCE = np.zeros((1 << 20, 16), np.float32)


def recorded(path, blocks: int) -> Recording:
    """Zeros, and a mark at the end."""
    made = Recording(path, 48_000, 16, "FLOAT")
    for _ in range(blocks):
        made.write(SILENCE)
    made.write(MARK)
    made.close()
    return made


@unix
@pytest.mark.hard  # it passes 4 GiB through memory
@pytest.mark.parametrize("kind", ["wav", "w64", "caf"])
def test_a_recording_of_more_than_4_gib_is_read_to_its_end(tmp_path, sparse, kind):
    path = tmp_path / f"a.{kind}"
    made, frames = recorded(path, 65), 65 * len(SILENCE) + len(MARK)
    assert made.is_complete and path.stat().st_size > 1 << 32
    with soundfile.SoundFile(path) as file:
        assert file.frames == frames
        file.seek(frames - len(MARK))
        np.testing.assert_array_equal(file.read(), MARK)
    with path.open("rb") as file:
        assert file.read(4) == {"wav": b"RF64", "w64": b"riff", "caf": b"caff"}[kind]


@pytest.mark.parametrize("kind", ["aiff", "au", "voc"])
def test_a_format_of_4_gib_says_that_it_ends(tmp_path, monkeypatch, capsys, kind):
    """The limit is lowered for it."""
    monkeypatch.setattr("engine.live.audio_recording.MAX_BYTES", 1_000_000)
    made = Recording(tmp_path / f"a.{kind}", 44_100, 1, "PCM_16")
    for _ in range(100):
        made.write(NOISE)
    made.close()
    assert not made.is_complete and f"({kind.upper()} files hold 4 GiB)" in capsys.readouterr().err
    assert 400_000 < soundfile.info(tmp_path / f"a.{kind}").frames < 500_000


def test_a_shorter_recording_is_a_plain_wav(tmp_path):
    recorded(tmp_path / "a.wav", 1)
    assert (tmp_path / "a.wav").read_bytes()[:4] == b"RIFF"
    assert soundfile.info(tmp_path / "a.wav").frames == len(SILENCE) + len(MARK)


def test_a_render_of_more_than_4_gib_becomes_rf64(tmp_path, monkeypatch):
    """The limit is lowered for it: such a sound has 8 GiB of memory."""
    monkeypatch.setattr("engine.audio_formats.MAX_BYTES", 50_000)
    save_audio(tmp_path / "a.wav", NOISE, 44_100, None)
    assert (tmp_path / "a.wav").read_bytes()[:4] == b"RF64" and soundfile.info(tmp_path / "a.wav").frames == len(NOISE)
    save_audio(tmp_path / "b.wav", NOISE, 44_100, "PCM_16")
    assert (tmp_path / "b.wav").read_bytes()[:4] == b"RIFF"
    with pytest.raises(RuntimeError, match=r"AIFF files hold 4 GiB at most; \.wav, \.w64, \.caf"):
        save_audio(tmp_path / "a.aiff", NOISE, 44_100, "FLOAT")


# --- equal files


@pytest.mark.parametrize("subtype", ["FLOAT", "DOUBLE", "PCM_24", "PCM_16"])
@pytest.mark.parametrize("kind", sorted(set(soundfile.available_formats()) - {"RAW", "SD2"}))
def test_equal_sounds_are_equal_files(tmp_path, monkeypatch, kind, subtype):
    """At different times: libsndfile asks the clock for a PEAK chunk, for the number of an Ogg stream."""
    if not soundfile.check_format(kind, subtype):
        subtype = None
    if subtype is None and not soundfile.default_subtype(kind):
        pytest.skip("needs a sample format")
    files = []
    for name in "ab":
        path = tmp_path / f"{name}.{kind.lower()}"
        try:
            save_audio(path, NOISE[:3000], 44_100 if kind == "XI" else 8000, subtype)
        except RuntimeError as error:
            pytest.skip(str(error))
        files.append(path.read_bytes())
        time.sleep(1.1 if name == "a" and kind in ("WAV", "WAVEX", "AIFF", "OGG", "MAT5", "RF64") else 0.0)
    assert files[0] == files[1]
    assert soundfile.info(tmp_path / f"b.{kind.lower()}").frames >= 3000


def test_an_ogg_file_is_whole(tmp_path):
    """Its check sums hold, page by page: without them, a reader finds nothing."""
    sound = 0.3 * np.sin(np.arange(300_000) / 15)[:, None] * np.ones(2)
    save_audio(tmp_path / "a.ogg", sound, 44_100, None)
    heard = soundfile.read(tmp_path / "a.ogg")[0]
    assert heard.shape == sound.shape and np.abs(heard - sound)[1000:-1000].max() < 0.02


# --- what stands there


@unix
def test_a_link_is_followed(tmp_path, capsys):
    (tmp_path / "away").mkdir()
    (tmp_path / "link.wav").symlink_to("away/real.wav")
    (tmp_path / "second.wav").symlink_to("link.wav")
    for link, gain in (("link.wav", "0"), ("second.wav", "-20")):  # the first leads to nothing yet
        assert render(tmp_path / link, "--gain", gain, "--subtype", "DOUBLE") == 0
        assert (tmp_path / link).is_symlink()
    render(tmp_path / "alone.wav", "--gain", "-20", "--subtype", "DOUBLE")
    assert (tmp_path / "away" / "real.wav").read_bytes() == (tmp_path / "alone.wav").read_bytes()
    assert [p.name for p in (tmp_path / "away").iterdir()] == ["real.wav"]


@unix
@pytest.mark.parametrize(
    "write",
    [
        lambda path: save_audio(path, NOISE, 8000, None),
        lambda path: write_text(path, "a"),
        lambda path: save_trace(path, {"a": NOISE}),
        lambda path: recorded(path, 0),
    ],
)
def test_a_file_keeps_its_mode_and_a_link_its_file(tmp_path, write):
    path, link = tmp_path / "a.wav", tmp_path / "link.wav"
    path.write_text("before")
    path.chmod(0o600)
    link.symlink_to(path)
    write(link)
    assert link.is_symlink() and stat.S_IMODE(path.stat().st_mode) == 0o600 and path.stat().st_size != 6


@unix
@pytest.mark.parametrize("option", ["--output", "--trace", "--report", "--plot"])
def test_a_read_only_file_is_refused_before_anything_is_rendered(tmp_path, monkeypatch, capsys, option):
    ending = {"--output": "wav", "--trace": "npz", "--report": "html", "--plot": "png"}[option]
    path = tmp_path / f"a.{ending}"
    path.write_text("precious")
    path.chmod(0o444)
    (tmp_path / f"link.{ending}").symlink_to(path)
    monkeypatch.setattr("engine.api.rendering.render", None)
    for name in (path, tmp_path / f"link.{ending}"):
        given = [] if option == "--output" else ["-o", str(tmp_path / "b.wav")]
        assert main.main(["render", BALL, *given, option, str(name)]) == 2
        assert f"{option}: {name} is read-only; write elsewhere" in capsys.readouterr().err
    with pytest.raises(OSError, match="read-only"):
        save_audio(path, NOISE, 8000, None) if ending == "wav" else write_text(path, "")
    assert path.read_text() == "precious"


@unix
@pytest.mark.parametrize("kind", ["wav", "flac", "ogg"])
def test_a_named_pipe_is_sent_the_sound(tmp_path, capsys, kind):
    pipe, heard = tmp_path / f"p.{kind}", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: heard.append(pipe.read_bytes()))
    reader.start()
    assert render(pipe) == 0
    reader.join(10.0)
    render(tmp_path / f"file.{kind}")
    assert heard == [(tmp_path / f"file.{kind}").read_bytes()] and stat.S_ISFIFO(pipe.stat().st_mode)


@unix
def test_devices_folders_and_loops(tmp_path, capsys):
    for name, target in (("null", "/dev/null"), ("full", "/dev/full"), ("loop", "loop.wav"), ("folder", ".")):
        (tmp_path / f"{name}.wav").symlink_to(target)
    assert render(tmp_path / "null.wav") == 0
    assert render(tmp_path / "full.wav") == 1 and "(no space left on device)" in capsys.readouterr().err
    assert render(tmp_path / "loop.wav") == 2 and "too many levels of symbolic links" in capsys.readouterr().err
    assert render(tmp_path / "folder.wav") == 2 and "is a folder" in capsys.readouterr().err
    words = ["play", BALL, "--record", str(tmp_path / "null.wav")]
    assert main.main(words) == 2
    assert "null.wav is a pipe or a device; give the name of a file, which can grow" in capsys.readouterr().err


@unix
@pytest.mark.parametrize("stem", ["x" * 251, "é" * 125, "音" * 83 + "xx"])
def test_a_name_of_255_bytes(tmp_path, stem):
    path = tmp_path / f"{stem}.wav"
    assert len(os.fsencode(path.name)) in (254, 255)
    assert render(path) == 0 and recorded(path, 0).is_complete
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    shutil.rmtree(tmp_path)


@unix
def test_two_names_of_one_file_are_refused(tmp_path, capsys):
    (tmp_path / "b.npz").symlink_to("a.wav")
    assert render(tmp_path / "a.wav", "--trace", str(tmp_path / "b.npz")) == 2
    assert "would be written twice" in capsys.readouterr().err
