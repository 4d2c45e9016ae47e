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
from engine.live.audio_recording import Recording
from engine.output_files import save_audio
from engine.report.html import encode_for_browser
from engine.sound.form import SoundForm
from engine.sound.sound_file import SoundFile
from engine.sweep.common_gain import rescale

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
    assert kind == "SD2" or any(good and counts for good, counts in groups), "nothing is held"
    for (good, counts), rates in groups.items():
        alone = [[rate] for rate in rates] if kind == "OGG" and not good else [rates]
        for some in alone if counts and kind != "SD2" else []:
            code, found = tried(some, counts)
            if kind == "OGG" and not good:
                assert code != 0, some
            else:
                assert code == 0 and {told for *_, told in found} == {str(good)}, (found, good)


def noise(bits: int) -> np.ndarray:
    """Noise of many steps of so many bits, and full scale and more at its end [frames, 2]."""
    sound = np.random.default_rng(bits).uniform(-0.9, 0.9, (40_000, 2))
    return np.vstack([sound, [[1.0, -1.0], [1.5, -1.5], [1.0 - 2.0**-30, -1.0 - 2.0**-30]]])


def check_rounded(path: Path, sound: np.ndarray, bits: int) -> None:
    """The samples of a file are the nearest to those of a sound, and none has wrapped."""
    read, step = soundfile.read(path, dtype="int32", always_2d=True)[0], 2.0 ** (1 - bits)
    errors = (read * 2.0**-31 - np.clip(sound, -1.0, 1.0 - step)) / step
    assert abs(errors).max() <= 0.5 + 1e-6
    assert abs(errors[:-3].mean()) < 0.01
    assert (np.sign(read[-3:]) == np.sign(sound[-3:])).all()


@pytest.mark.parametrize("bits", [16, 24])
@pytest.mark.parametrize("kind", [".wav", ".flac", ".aiff", ".caf", ".w64"])
def test_integers_are_rounded_and_full_scale_does_not_wrap(tmp_path, kind, bits):
    """In files, in recordings of live sound in blocks, and at one gain after a sweep."""
    sound, path, subtype = noise(bits), tmp_path / f"a{kind}", f"PCM_{bits}"
    save_audio(path, sound, 44_100, subtype)
    check_rounded(path, sound, bits)
    single = sound.astype(np.float32)
    recording = Recording(tmp_path / f"b{kind}", 44_100, 2, subtype)
    for begin in range(0, len(single), 1000):
        recording.write(single[begin : begin + 1000])
    recording.close()
    check_rounded(tmp_path / f"b{kind}", single.astype(float), bits)
    save_audio(tmp_path / "c.wav", sound, 44_100, "DOUBLE")
    rescale(tmp_path / "c.wav", SoundFile(path, SoundForm(subtype)), 0.0)
    check_rounded(path, sound, bits)


@pytest.mark.parametrize("kind", [".aiff", ".flac"])
def test_a_format_that_chooses_integers_by_itself_rounds_them_too(tmp_path, kind):
    sound, path = noise(16), tmp_path / f"a{kind}"
    save_audio(path, sound, 44_100, None)
    check_rounded(path, sound, 16)


def test_previews_of_reports_are_rounded(tmp_path):
    data, kind = encode_for_browser(noise(16), 44_100)
    assert kind == "audio/flac"
    (tmp_path / "a.flac").write_bytes(data)
    check_rounded(tmp_path / "a.flac", noise(16), 16)
