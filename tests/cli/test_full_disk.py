"""What is said of a disk that is full, and that nothing half-written counts as a sound."""

import os
import subprocess
import sys

import numpy as np
import pytest
import soundfile
from conftest import ROOT
from sweeps import MARBLE, Alone, plan, rows, swept

from engine.output_files import save_audio
from engine.sweep.sweep import run_sweep

NEAR = "body.marble.displacement=1e-4..1e-3:log:3"
NOISE = 0.1 * np.random.default_rng(1).normal(size=(50_000, 1))
ROOM = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))
"""
unix = pytest.mark.skipif(sys.platform == "win32", reason="no limits of files")


def limited(code, folder):
    """Run a program in a folder where a file may have 5000 bytes, which stands for a full disk."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    words = [sys.executable, "-c", ROOM + code]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.hard_for("a.wav", "a.ogg", "a.flac")
@unix
@pytest.mark.parametrize("name", ["a.wav", "a.flac", "a.ogg", "a.mp3", "a.aiff", "a.caf"])
def test_no_format_hides_that_the_disk_is_full(tmp_path, name):
    """libsndfile itself writes OGG and MP3 to the end, and does not tell."""
    (tmp_path / name).write_bytes(b"before")
    code = (
        "from engine.output_files import save_audio; import numpy, pathlib; noise = numpy.random.default_rng(1).normal"
    )
    code += f"; save_audio(pathlib.Path({name!r}), 0.1 * noise(size=(50_000, 1)), 44_100, None)"
    run = limited(code, tmp_path)
    assert run.returncode == 1 and "File too large" in run.stderr.splitlines()[-1]
    assert (tmp_path / name).read_bytes() == b"before"
    assert [p.name for p in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["a.wav", "a.ogg"])
def test_a_file_is_as_libsndfile_writes_it(tmp_path, name):
    save_audio(tmp_path / name, NOISE, 44_100, None)
    found, rate = soundfile.read(tmp_path / name, always_2d=True)
    assert rate == 44_100 and found.shape == NOISE.shape
    assert np.abs(found - NOISE).max() < (1e-7 if name == "a.wav" else 0.5)


def test_a_sweep_says_which_file_and_goes_on(tmp_path, monkeypatch):
    """The disk is full at the second sound, and then at the index."""
    folder, true = tmp_path / "a", save_audio
    full = {"0002_marble_displacement_0p000316228.wav"}

    def saved(path, *told):
        if path.name in full:
            raise OSError(28, os.strerror(28))
        true(path, *told)

    monkeypatch.setattr("engine.sound.sound_file.save_audio", saved)
    with pytest.raises(
        RuntimeError, match=r"cannot write .*/unscaled/0002_.*\.wav \(no space left on device\); when this is possible"
    ):
        run_sweep(plan(NEAR), folder, Alone(), {"seconds": 0.02, "samplerate": 44_100})
    assert [row["number"] for row in rows(folder)] == ["1"]
    full.clear()
    assert swept(folder, NEAR)[1] == [2, 3]


@pytest.mark.system
@unix
def test_a_sweep_of_too_little_room_on_the_command_line(tmp_path):
    """One line, exit code 1, and the next run goes on."""
    swept(tmp_path / "compiled", NEAR)  # for there is no room to keep kernels
    words = ["sweep", MARBLE, "--vary", NEAR, "--cores", "1", "-o", "a", "--seconds", "0.2"]
    run = limited(f"from engine.cli import main; sys.exit(main.main({words}))", tmp_path)
    assert run.returncode == 1
    assert run.stderr.splitlines()[-1].startswith(
        "fdh: cannot write a/unscaled/0001_marble_displacement_0p0001.wav (file too large); when this is possible"
    )
    assert "Traceback" not in run.stderr
    assert [p.name for p in (tmp_path / "a").rglob("*") if p.is_file()] == ["index.csv"]
