"""Which rates and channels audio formats hold: what is refused, before anything is rendered."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT

from engine import audio_formats
from engine.cli import main
from engine.output_files import save_audio

PATCH = str(ROOT / "patches" / "repelled_oscillator.toml")
RATES = 4000, 8000, 11_025, 44_100, 48_000, 65_535, 65_536, 96_000, 192_000, 200_000, 200_001, 384_000, 655_350, 768_000
COUNTS = 1, 2, 8, 9, 16
WRITTEN = """
import sys
import numpy as np, soundfile
kind, subtype, path = sys.argv[1:4]
for rate in map(int, sys.argv[4].split(",")):
    for count in map(int, sys.argv[5].split(",")):
        sound = 0.5 * np.sin(np.arange(3000) / 9)[:, None] * np.ones(count)
        print(rate, count, end=" ", flush=True)
        try:
            soundfile.write(path, sound, rate, subtype or None, format=kind)
            told = {"samplerate": rate, "channels": count, "subtype": subtype, "format": kind} if kind == "RAW" else {}
            read, kept = soundfile.read(path, always_2d=True, **told)
            print(kept == rate and read.shape == sound.shape)
        except Exception as error:
            print(False)
"""


@pytest.mark.parametrize(
    ("name", "rate", "channels", "says"),
    [
        (
            "a.ogg",
            384_000,
            1,
            "OGG files hold 200000 Hz at most, and the sound has 384000; .wav, .flac, .aiff, .caf",
        ),
        ("a.flac", 44_100, 16, "FLAC files hold 8 channels at most, and the sound has 16; .wav, .ogg, .aiff, .caf"),
        ("a.flac", 100_001, 1, "hold rates above 65535 Hz in tens of Hz"),
        ("a.flac", 768_000, 1, "FLAC files hold 655350 Hz at most"),
        ("a.mp3", 96_000, 2, "MP3 files hold 8000, 11025, 12000, 16000"),
        ("a.svx", 44_100, 2, "SVX files hold 1 channel at most"),
        ("a.htk", 44_100, 1, "HTK files hold no rate of 44100 Hz exactly"),
        ("a.sd2", 44_100, 1, "have a second file beside them"),
        ("a.wav", 768_000, 16, ""),
        ("a.ogg", 200_000, 16, ""),
    ],
)
def test_what_a_format_cannot_hold(name, rate, channels, says):
    found = audio_formats.explain_unsupported_format(Path(name), rate, channels)
    assert says in found and bool(says) == bool(found)


def test_it_is_refused_before_anything_is_rendered(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("engine.cli.rendering.render_from_arguments", None)
    monkeypatch.setattr("engine.cli.live_session.play_patch", None)
    assert main.main([PATCH, "--samplerate", "384000", "-o", "a.ogg"]) == 2
    assert capsys.readouterr().err.startswith("fdh --output: OGG files hold 200000 Hz at most")
    assert main.main(["play", PATCH, "--samplerate", "96000", "--record", "a.mp3"]) == 2
    assert "fdh --record: MP3 files hold 8000, " in capsys.readouterr().err
    assert main.main([PATCH, "-o", "a.raw"]) == 2
    assert "--subtype: RAW files do not store their sample format; give --subtype FLOAT" in capsys.readouterr().err
    assert main.main([PATCH, "--samplerate", "nan", "-o", "a.ogg"]) == 2
    assert not list(tmp_path.iterdir())
    with pytest.raises(RuntimeError, match="OGG files hold"):
        save_audio(tmp_path / "a.ogg", np.zeros((10, 1)), 384_000, None)


@pytest.mark.hard
@pytest.mark.parametrize("kind", sorted(soundfile.available_formats()))
def test_all_else_is_held(tmp_path, kind):
    """Written in a program of its own, for what is not held may end it; and what is refused is not held."""
    subtype = "FLOAT" if kind == "RAW" else ""

    def tried(rates, counts):
        words = [kind, subtype, str(tmp_path / "a"), ",".join(map(str, rates)), ",".join(map(str, counts))]
        run = subprocess.run([sys.executable, "-c", WRITTEN, *words], capture_output=True, text=True, check=False)
        return run.returncode, [line.split() for line in run.stdout.splitlines()]

    output, groups = Path(f"a.{kind.lower()}"), dict[tuple[bool, tuple[int, ...]], list[int]]()
    for rate in RATES:
        held = tuple(count for count in COUNTS if not audio_formats.explain_unsupported_format(output, rate, count))
        groups.setdefault((True, held), []).append(rate)
        groups.setdefault((False, tuple(set(COUNTS) - set(held))), []).append(rate)
    for (good, counts), rates in groups.items():
        alone = [[rate] for rate in rates] if kind == "OGG" and not good else [rates]
        for some in alone if counts and kind != "SD2" else []:
            code, found = tried(some, counts)
            if kind == "OGG" and not good:
                assert code != 0, some
            else:
                assert code == 0 and {told for *_, told in found} == {str(good)}, (found, good)
